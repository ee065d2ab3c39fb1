"""Works for processes of their own, and parts that measure nothing."""

from __future__ import annotations

import os
import time

from lndrl.bench.gpu.parts import Tell
from lndrl.errors import UserError


def tells(tell: Tell, value: float) -> None:
    tell(value, "deep", "figure")
    tell(os.getpid(), "process")


def fails(tell: Tell, value: float) -> None:
    tell(value, "before")
    raise ZeroDivisionError("no such\nluck")


def refuses(tell: Tell) -> None:
    raise UserError("no GPU today")


def dies(tell: Tell) -> None:
    tell(os.getpid(), "process")
    os._exit(13)


def hangs(tell: Tell) -> None:
    tell(os.getpid(), "process")
    time.sleep(600)
