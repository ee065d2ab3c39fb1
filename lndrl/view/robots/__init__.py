"""What people see of robots: a live drive, and what a recording says of the belief."""
