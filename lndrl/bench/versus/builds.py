"""Other builds of this program: commits taken out of the repository that it runs from."""

from __future__ import annotations

import shutil
import subprocess
import tarfile
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import yaml

from lndrl.caches import user_cache
from lndrl.config import REPOSITORY_CONFIGS
from lndrl.errors import UserError

ROOT = Path(__file__).resolve().parents[3]
"""Where this program's own files are."""

_FIRST_WORLD = "benchmark-v1.yaml"


@dataclass(frozen=True)
class Other:
    """Another build: its commit, where its files are, what this one is told to be like it."""

    commit: str
    folder: Path
    settings: tuple[str, ...]


def prepare(commit: str) -> Other:
    """Take ``commit`` out of this program's repository, or find what was taken before.

    Raises UserError where there is no repository, no such commit, or no ``lndrl bench`` in it.
    """
    whole = _git("rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}").decode().strip()
    if not whole:
        raise UserError(f"--vs {commit}: not a commit of {ROOT}; git log there shows those")
    folder = Path(user_cache("builds")) / whole[:12]
    if not folder.is_dir():
        archive = _git("archive", "--format=tar", whole)
        with tempfile.TemporaryDirectory(dir=_made(folder.parent)) as made:
            packed = Path(made) / "build.tar"
            packed.write_bytes(archive)
            with tarfile.open(packed, encoding="utf-8") as tar:
                tar.extractall(Path(made) / "build", filter="data")
            with suppress(OSError):  # somebody else was faster
                (Path(made) / "build").rename(folder)
    if not (folder / "lndrl/bench").is_dir():
        raise UserError(f"--vs {commit}: that build has no lndrl bench")
    # Before there was a second world the first one had no file of its own.
    first = () if (folder / "configs" / _FIRST_WORLD).exists() else _first_world()
    return Other(whole[:12], folder, first)


def _first_world() -> tuple[str, ...]:
    """How this program's world is that of version 1 again, whatever its defaults are by now."""
    content = yaml.safe_load((REPOSITORY_CONFIGS / _FIRST_WORLD).read_text("utf-8"))
    return tuple(content["set"])


def _git(*arguments: str) -> bytes:
    if shutil.which("git") is None:
        raise UserError("--vs takes the other build out of a repository by git, which is missing")
    inside = subprocess.run(
        ["git", "-C", str(ROOT), "rev-parse", "--git-dir"], capture_output=True, check=False
    )
    if inside.returncode:
        raise UserError(f"--vs: {ROOT} is no git repository; run it from a clone")
    done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, check=False)
    return done.stdout


def _made(folder: Path) -> Path:
    folder.mkdir(0o700, parents=True, exist_ok=True)
    return folder
