"""The bench: what it finds, how it is shown, and how its world was calibrated."""
