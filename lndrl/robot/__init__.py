"""A real robot: its shape, its sensors, the guard over its commands, and what it speaks."""
