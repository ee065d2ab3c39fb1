"""``lndrl/Navigation-v0`` is known to Gymnasium, whoever is imported first; and nothing is slow."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from importlib import metadata
from pathlib import Path

import gymnasium
import pytest
from hatchling.build import build_wheel

import lndrl
from lndrl import registration

ROOT = Path(__file__).resolve().parents[2]
KNOWN = "assert gymnasium.spec('lndrl/Navigation-v0').vector_entry_point"


def run(code: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """``code`` in another Python in ``folder``, which finds this package as a checkout."""
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize(
    "code",
    [
        "import lndrl, gymnasium; " + KNOWN,
        "import gymnasium, lndrl; " + KNOWN,
        "from lndrl.config import load_config; import gymnasium; " + KNOWN,
        "import gymnasium; gymnasium.make('lndrl:lndrl/Navigation-v0')",
    ],
)
def test_in_every_order_and_without_a_warning(code: str, tmp_path: Path) -> None:
    done = run(code, tmp_path)
    said = [line for line in done.stderr.splitlines() if not line.startswith("compiling kernels")]
    assert (done.returncode, said) == (0, [])


def test_importing_the_package_imports_nothing_heavy(tmp_path: Path) -> None:
    heavy = ("torch", "numba", "numpy", "gymnasium", "typing", "pydantic")
    code = (
        f"import sys; before = set(sys.modules); import lndrl; "
        f"print([m for m in {heavy!r} if m in set(sys.modules) - before], lndrl.__version__)"
    )
    done = run(code, tmp_path)
    assert done.stdout == f"[] {lndrl.__version__}\n", done.stderr


def test_it_is_registered_once(recwarn: pytest.WarningsRecorder) -> None:
    registration.register_environment()
    registration.register_with_gymnasium()
    assert not any("verriding" in str(warning.message) for warning in recwarn)
    assert list(gymnasium.registry).count("lndrl/Navigation-v0") == 1


def test_waiting_twice_waits_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "gymnasium.envs.registration")
    finders = list(sys.meta_path)
    monkeypatch.setattr(sys, "meta_path", finders)
    registration.register_with_gymnasium()
    registration.register_with_gymnasium()
    assert len(finders) == len([f for f in finders if not isinstance(f, registration._Wait)]) + 1


def test_the_front_door_offers_what_it_names() -> None:
    for name in lndrl.__all__:
        assert getattr(lndrl, name) is not None
        assert name in dir(lndrl)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = lndrl.nothing


def test_a_wheel_needs_no_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    wheel = tmp_path / build_wheel(str(tmp_path))
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as opened:
        opened.extractall(site)
    # What Python does at its start for the folder that a wheel is installed to.
    start = f"import site, sys; site.addsitedir({str(site)!r}); "
    code = start + "assert 'lndrl' not in sys.modules; import gymnasium; " + KNOWN
    done = run(code, tmp_path, PYTHONPATH="")
    assert (done.returncode, done.stderr) == (0, "")
    (point,) = metadata.distribution("lndrl").entry_points.select(group="none") or [None]
    assert point is None
    found = metadata.Distribution.at(next(site.glob("lndrl-*.dist-info"))).entry_points
    (point,) = found.select(group="gymnasium.envs")
    assert point.name == "lndrl" and point.load() is registration.register_environment


@pytest.mark.parametrize(
    "text",
    [
        "",
        "registry = None",
        "registry = {}\ndef register(id, entry_point): registry[id] = entry_point",
        "registry = {}\ndef register(**_): raise ValueError('no')",
    ],
)
def test_another_gymnasium_stays_whole_for_others(text: str, tmp_path: Path) -> None:
    envs = tmp_path / "gymnasium" / "envs"
    envs.mkdir(parents=True)
    for folder in (envs.parent, envs):
        (folder / "__init__.py").touch()
    (envs / "registration.py").write_text(f"{text}\nLOADED = True\n")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        "from lndrl.registration import register_with_gymnasium as register; register()\n"
        "from gymnasium.envs.registration import LOADED; print(LOADED)"
    )
    done = run(code, tmp_path, PYTHONWARNINGS="error")
    assert done.stdout == "True\n", done.stderr
    (said,) = done.stderr.splitlines()
    assert said.startswith("Gymnasium does not take the environment lndrl/Navigation-v0 (")
