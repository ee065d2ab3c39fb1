"""What people see: the dashboard (``dashboard/``), drawings (``pictures/``), bars and tables.

Import from the modules themselves. They are not gathered here because a progress bar should not
load matplotlib.
"""
