"""Which card it is, and whether it computes."""

from __future__ import annotations

import shutil
import subprocess
from contextlib import suppress

import torch

from lndrl.bench.gpu.parts import Tell
from lndrl.bench.gpu.plan import Plan
from lndrl.bench.report import device_name, median_seconds
from lndrl.errors import UserError
from lndrl.policy import resolve_device

_TRIED = 256  # side of the product that is compared with the CPU's
_TOLERANCE = 1e-4  # of its largest number; without TF32 float32 is far closer


def measure(tell: Tell, plan: Plan) -> None:
    """Tell its name and kind, compare a product with the CPU's, time one in bfloat16.

    Raises UserError where the product is another.
    """
    place = resolve_device(plan.device)
    tell(device_name(place), "name")
    if place.type == "cuda":
        facts = torch.cuda.get_device_properties(place)
        tell(round(facts.total_memory / 2**30, 1), "gibibytes")
        tell(f"{facts.major}.{facts.minor}", "compute_capability")
        tell(facts.multi_processor_count, "multiprocessors")
        tell(_driver(), "driver")
    tell(str(torch.version.cuda), "cuda")
    tell(str(torch.backends.cudnn.version()), "cudnn")
    # What float32 means here: unless told otherwise, convolutions round their inputs.
    tell(torch.backends.cuda.matmul.allow_tf32, "tf32_products")
    tell(torch.backends.cudnn.allow_tf32, "tf32_convolutions")
    here = torch.randn(_TRIED, _TRIED, generator=torch.Generator().manual_seed(1))
    there = here.to(place)
    expected = here @ here
    difference = float(((there @ there).cpu() - expected).abs().max() / expected.abs().max())
    tell(difference, "difference_of_a_product")
    if not difference < _TOLERANCE:
        raise UserError(f"a product on {plan.device} is {difference:g} off that on the CPU")
    tell(_teraflops(place, plan), "bfloat16_teraflops")


def _teraflops(place: torch.device, plan: Plan) -> float:
    side = plan.matrix
    matrix = torch.randn(side, side, device=place, dtype=torch.bfloat16)

    def multiply() -> None:
        torch.mm(matrix, matrix)
        if place.type == "cuda":
            torch.cuda.synchronize(place)

    return 2e-12 * side**3 / median_seconds(multiply, plan.seconds)


def _driver() -> str:
    """The driver's version, as nvidia-smi says it."""
    if (program := shutil.which("nvidia-smi")) is not None:
        with suppress(OSError, subprocess.SubprocessError):
            query = [program, "--query-gpu=driver_version", "--format=csv,noheader"]
            done = subprocess.run(
                query, capture_output=True, text=True, encoding="utf-8", timeout=10, check=True
            )
            return done.stdout.splitlines()[0].strip() if done.stdout.strip() else "unknown"
    return "unknown"
