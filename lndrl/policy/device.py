"""Which device torch works on."""

from __future__ import annotations

import torch

from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores
from lndrl.machine.processor import described


def machine_with(device: torch.device) -> str:
    """This machine as it works on ``device``: processor, cores, and the GPU if it is one."""
    here = described(usable_cores())
    return here if device.type == "cpu" else f"{here}, {torch.cuda.get_device_name(device)}"


def resolve_device(name: str) -> torch.device:
    """The device called ``name``: cpu, cuda, cuda:N, or auto (CUDA where there is any).

    Raises UserError for anything else, and for a GPU that this machine or torch does not offer.
    """
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    try:
        device = torch.device(name)
    except RuntimeError:
        device = None
    if device is None or device.type not in ("cpu", "cuda"):
        raise UserError(f"device {name}: not a device; write cpu, cuda, cuda:0 or auto")
    if device.type == "cuda":
        _check_cuda(name, device.index or 0)
        return torch.device("cuda", device.index or 0)
    return torch.device("cpu")


def _check_cuda(name: str, index: int) -> None:
    if torch.version.cuda is None and torch.version.hip is None:
        raise UserError(
            f"device {name}: torch {torch.__version__} was built for CPUs only; use cpu"
        )
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if not count:
        raise UserError(f"device {name}: torch finds no GPU here; use cpu, or check the driver")
    if index >= count:
        last = f"cuda:0 to cuda:{count - 1}" if count > 1 else "cuda:0"
        raise UserError(f"device {name}: there is no such GPU; this machine has {last}")
