"""Carry what is missing to a machine that reaches no package index: a folder of wheels.

    .venv/bin/python deploy/wheels.py wheels --python 3.12 --torch 2.11 --installed there.txt

fills the folder ``wheels`` here, from the index that pip uses, at the versions of
requirements.lock. torch stays out: the machine has its own. ``there.txt`` is what it has besides,
as its ``python3 -m pip list --format=freeze`` says it; without it everything is carried. There,

    python3 -m pip install --no-index --no-deps --find-links wheels -r wheels/requirements.txt

installs them (with ``--target FOLDER`` and FOLDER in PYTHONPATH where nothing may be changed).
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
LEFT_OUT = {"torch"}
FOR_TESTS = ("pytest", "hypothesis")
"""What the tests that need a GPU need besides."""

_OLD_NAMES = {5: "manylinux1", 12: "manylinux2010", 17: "manylinux2014"}


class CannotCarryError(Exception):
    """One sentence about what is wrong."""


def wanted(pyproject: Path) -> list[Requirement]:
    """What the program needs at run time, and the tests on a GPU."""
    project = tomllib.loads(pyproject.read_text("utf-8"))["project"]
    needed = [Requirement(each) for each in project["dependencies"]]
    dev = [Requirement(each) for each in project["optional-dependencies"]["dev"]]
    return needed + [each for each in dev if each.name in FOR_TESTS]


def check_torch(version: str, needed: Iterable[Requirement]) -> None:
    """Raise CannotCarryError where torch ``version`` is none that the program can do with."""
    for each in needed:
        if each.name == "torch" and not each.specifier.contains(version):
            raise CannotCarryError(f"torch {version} will not do; it must be {each.specifier}")


def installed(text: str) -> dict[str, str]:
    """Versions by name from lines ``name==version``; "" where a line says a name alone."""
    found = {}
    for line in text.splitlines():
        name, _, version = line.strip().partition("==")
        if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name):
            found[canonicalize_name(name)] = version.partition("+")[0].strip()
    return found


def platforms(glibc: str) -> list[str]:
    """Names of all platforms that run on x86-64 with that glibc: pip takes them literally."""
    major, _, minor = glibc.partition(".")
    if major != "2" or not minor.isdigit() or int(minor) < min(_OLD_NAMES):
        raise CannotCarryError(f"--glibc {glibc} is none; say what `ldd --version` says, e.g. 2.28")
    names = []
    for number in range(int(minor), min(_OLD_NAMES) - 1, -1):
        names.append(f"manylinux_2_{number}_x86_64")
        if number in _OLD_NAMES:
            names.append(f"{_OLD_NAMES[number]}_x86_64")
    return names


def to_carry(
    needed: Iterable[Requirement],
    resolved: Mapping[str, Mapping[str, Any]],
    there: Mapping[str, str],
    python: str,
) -> list[str]:
    """Names of what has to travel: all that is ``needed``, less what is ``there`` and fits.

    ``resolved`` has the metadata of everything by name. What is there is taken to have what it
    needs itself. Raises CannotCarryError for what was not resolved.
    """
    environment = {
        "python_version": python,
        "python_full_version": f"{python}.0",
        "sys_platform": "linux",
        "platform_system": "Linux",
        "platform_machine": "x86_64",
        "os_name": "posix",
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
        "extra": "",
    }
    carried: set[str] = set()
    waiting = list(needed)
    while waiting:
        each = waiting.pop(0)
        name = canonicalize_name(each.name)
        if name in LEFT_OUT or name in carried:
            continue
        if each.marker is not None and not each.marker.evaluate(environment):
            continue
        version = there.get(name)
        if version is not None and (not version or each.specifier.contains(version, True)):
            continue
        if name not in resolved:
            raise CannotCarryError(f"{each} is for Python {python} alone; run this by that Python")
        carried.add(name)
        waiting += [Requirement(more) for more in resolved[name].get("requires_dist", [])]
    return sorted(carried)


def prepare(folder: Path, python: str, glibc: str, there: Mapping[str, str]) -> list[str]:
    """Fill ``folder``; returns ``name==version`` of all that is in it."""
    needed = wanted(ROOT / "pyproject.toml")
    target = ["--only-binary=:all:", "--implementation", "cp", "--python-version", python]
    for name in platforms(glibc):
        target += ["--platform", name]
    resolved = _resolve(needed, target)
    pins = [
        f"{name}=={resolved[name]['version']}" for name in to_carry(needed, resolved, there, python)
    ]
    folder.mkdir(parents=True, exist_ok=True)
    if pins:
        _pip(["download", "--no-deps", "--dest", str(folder), *target, *pins])
    (folder / "requirements.txt").write_text("".join(f"{pin}\n" for pin in pins), "utf-8")
    return pins


def _resolve(needed: Sequence[Requirement], target: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Metadata by name of all that ``needed`` need, at the versions of the lock."""
    names = [str(each) for each in needed if each.name not in LEFT_OUT]
    with tempfile.TemporaryDirectory() as place:
        report = Path(place) / "report.json"
        _pip(
            [
                *("install", "--dry-run", "--ignore-installed", "--target", f"{place}/none"),
                *("--report", str(report), "--constraint", str(ROOT / "requirements.lock")),
                *(*target, *names),
            ]
        )
        items = json.loads(report.read_text("utf-8"))["install"]
    return {canonicalize_name(each["metadata"]["name"]): each["metadata"] for each in items}


def _pip(arguments: Sequence[str]) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments]
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        check=False,
    )  # fmt: skip
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.startswith("ERROR:")]
        said = (lines or done.stderr.strip().splitlines() or ["nothing said"])[0]
        raise CannotCarryError(f"pip {arguments[0]} failed: {said.removeprefix('ERROR: ')}")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the wheels go")
    parser.add_argument("--python", default="3.12", help="version there, e.g. 3.12")
    parser.add_argument("--torch", default="2.11", help="version there, e.g. 2.11")
    parser.add_argument("--glibc", default="2.28", help="version there, or an older one")
    parser.add_argument("--installed", type=Path, help="what pip list --format=freeze says there")
    given = parser.parse_args(arguments)
    try:
        check_torch(given.torch, wanted(ROOT / "pyproject.toml"))
        there = installed(given.installed.read_text("utf-8")) if given.installed else {}
        pins = prepare(given.folder, given.python, given.glibc, there)
    except CannotCarryError as error:
        print(f"wheels: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"wheels: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    size = sum(path.stat().st_size for path in given.folder.glob("*.whl"))
    print("\n".join(pins))
    print(f"{len(pins)} packages, {size / 2**20:.0f} MiB in {given.folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
