"""The version of the program; learner and actors must agree on it."""

from __future__ import annotations

VERSION = "0.1.0"
