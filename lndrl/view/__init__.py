"""Drawings, curves, tables and the dashboard.

Import from the modules themselves: ``dashboard`` (the picture of a status), ``live`` and ``feed``
(that picture over time), ``world`` and ``film`` (worlds and beliefs), ``curves`` (learning
curves), ``progress`` (bars and tables). They are not gathered here because a progress bar should
not load matplotlib.
"""
