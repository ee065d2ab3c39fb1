"""The policy that comes with the program, in half precision, and how weights get there and back."""

from lndrl.policy.shipped.half import (
    LARGEST_FILE,
    ROBOT_FILE,
    SHIPPED_FILE,
    WALK_FILE,
    narrowed,
    parameters_in,
    widened,
)

__all__ = [
    "LARGEST_FILE",
    "ROBOT_FILE",
    "SHIPPED_FILE",
    "WALK_FILE",
    "narrowed",
    "parameters_in",
    "widened",
]
