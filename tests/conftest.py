"""Settings that every test shares, made before numpy and torch are imported."""

from __future__ import annotations

import os
import secrets
import signal
import sys
import textwrap
from collections.abc import Callable, Iterator
from importlib import invalidate_caches
from pathlib import Path

# Tests run beside each other; more threads each would only slow all of them down.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Compiled code is kept even where the environment says not to: the tests start hundreds of
# processes, each of which would compile all that it imports.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

import pytest  # noqa: E402
from hypothesis import HealthCheck, settings  # noqa: E402

from lndrl import extensions  # noqa: E402

ROOT = Path(__file__).parent
LONGEST = [
    "lndrl/policy/export/test_export.py",
    "test_system.py",
    "learner/ppo/test_imitation.py",
    "chaos/test_chaos.py",
    "lndrl/placement/test_up.py",
    "chaos/test_hosts.py",
    "actors/test_fleet.py",
    "deploy/test_sbatch.py",
    "lndrl/policy/export/test_convert.py",
    "lndrl/robot/driving/test_service.py",
    "lndrl/bench/gpu/test_apart.py",
    "lndrl/kernels/test_store.py",
    "lndrl/evaluation/test_pool.py",
    "lndrl/view/dashboard/test_terminal.py",
    "lndrl/view/dashboard/test_training.py",
    "learner/ranks/test_job.py",
    "learner/ppo/test_update.py",
    "lndrl/test_deployment_page.py",
    "lndrl/transport/security/test_access.py",
    "lndrl/view/pictures/test_fitting.py",
    "chaos/test_flood.py",
    "lndrl/bench/test_tls.py",
    "lndrl/bench/test_memory.py",
    "deploy/test_page.py",
]
"""Files that take longest, longest first: one that is begun last is waited for by all workers."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest files; ``--no-loadscope-reorder`` keeps pytest-xdist to that."""
    places = {ROOT / name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path, len(places)))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what is marked ``cuda`` where there is no GPU."""
    if item.get_closest_marker("cuda") is not None:
        import torch

        if not torch.cuda.is_available():
            pytest.skip("needs a CUDA GPU")


# Under nohup, or as a script's background job, a process is born deaf to these, and so is all that
# it starts; what they do to a program is what some tests are about.
for _number, _handler in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGQUIT, signal.SIG_DFL),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _handler)

# No deadline: the first example compiles the kernel. Derandomized: a red test is red again.
settings.register_profile(
    "lndrl", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("lndrl")


@pytest.fixture
def own_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., str]]:
    """Writes a user's module, beside the tests' folder, where Python finds it; returns its name.

    ``trusted`` lets this process import it; nothing of that outlives the test.
    """
    folder = tmp_path / "own"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(extensions, "_trusted", {})
    written: list[str] = []

    def write(text: str, name: str = "", trusted: bool = True) -> str:
        name = name or f"own_{secrets.token_hex(4)}"
        (folder / f"{name}.py").write_text(textwrap.dedent(text))
        invalidate_caches()
        written.append(name)
        if trusted:
            extensions.trust_modules(name)
        return name

    yield write
    for name in written:
        sys.modules.pop(name, None)


@pytest.fixture
def install(own_module: Callable[..., str]) -> Iterator[Callable[[str, str, str, str], None]]:
    """Installs a package that offers an entry point: (package, group, name, value)."""

    def add(package: str, group: str, name: str, value: str) -> None:
        information = Path(sys.path[0]) / f"{package}-1.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n"
        )
        (information / "entry_points.txt").write_text(f"[{group}]\n{name} = {value}\n")
        invalidate_caches()
        extensions._entry_points.cache_clear()

    yield add
    extensions._entry_points.cache_clear()
