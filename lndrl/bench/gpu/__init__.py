"""``lndrl bench gpu``: all that wants a GPU, in one command of a few minutes.

Parts follow each other within a budget of time (``parts``). What is done with the device has a
process of its own (``apart``): neither an error nor a hang of one part takes the others with it.
"""

from lndrl.bench.gpu.plan import Plan, full_plan, rehearsal
from lndrl.bench.gpu.script import check_device, content, has_failed, measure
from lndrl.bench.gpu.table import table

__all__ = [
    "Plan",
    "check_device",
    "content",
    "full_plan",
    "has_failed",
    "measure",
    "rehearsal",
    "table",
]
