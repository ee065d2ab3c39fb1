"""ROS 2 over Zenoh, without ROS: two dialects, and sessions that speak one of them."""

from lndrl.robot.link.dialect import (
    LATCHED,
    RELIABLE,
    SENSOR,
    Endpoint,
    Quality,
    Topic,
)
from lndrl.robot.link.session import DIALECTS, Address, Arrival, Link, Publisher, open_link

__all__ = [
    "DIALECTS",
    "LATCHED",
    "RELIABLE",
    "SENSOR",
    "Address",
    "Arrival",
    "Endpoint",
    "Link",
    "Publisher",
    "Quality",
    "Topic",
    "open_link",
]
