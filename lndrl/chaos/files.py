"""Damaged files, drawn from a seed, given to the loaders of this program.

A loader may refuse a file with a sentence (UserError, ValueError) or take it; anything else that
it raises is a crash.
"""

from __future__ import annotations

import random
import re
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lndrl.config import REPOSITORY_CONFIGS, load_config, load_scenario, parse_config
from lndrl.errors import UserError
from lndrl.maps.ros_map import load_ros_map
from lndrl.numbering import by_number
from lndrl.policy import load_policy

SHOWN = 10
STRANGE = (
    "", "null", "-1", "0", "1e308", ".nan", ".inf", "-.inf", "[]", "{}", "[[[]]]", "true", "'", '"',
    "&a [*a]", "*nobody", "!!python/object:os.system x", "!!binary x", "2001-99-99", "0x", "1_0",
    "99999999999999999999999", "x" * 3000, "\u0000", "é", "? :", "- -", "<<: 1", "[" * 1500,
    "1:99:99", "../../etc/passwd", "/dev/zero/x", "~", "0o9", "12e", "{a: 1, a: 2}", "%", "@", "`",
)  # fmt: skip
SMALL = {
    "network": {"map_channels": [2, 2, 2], "features": 4, "goal_features": 2},
    "learner": {"threads": 1},
}


@dataclass
class FileFindings:
    """Files given to loaders: how many, how many were refused, and what crashed."""

    given: int = 0
    refused: int = 0
    crashes: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)

    def note(self, kind: str, what: str, error: BaseException | None) -> None:
        """One more file, and what its loader raised."""
        self.given += 1
        self.kinds[kind] += 1
        if isinstance(error, UserError | ValueError):
            self.refused += 1
        elif error is not None:
            self.crashes += 1
            if len(self.examples) < SHOWN:
                self.examples.append(f"{kind} file, {what}: {type(error).__name__}: {error}"[:300])


@dataclass(frozen=True)
class Sample:
    """A good file to damage: its kind, and how the program loads it."""

    kind: str
    path: Path
    load: Callable[[], Any]


def fuzz_files(
    count: int, seed: int, folder: Path, stopped: Callable[[], bool] = bool
) -> FileFindings:
    """Damage ``count`` files in ``folder`` (made here) and load them."""
    samples = make_samples(folder)
    draw = random.Random(f"files {seed}")
    found = FileFindings()
    for _ in range(count):
        if stopped():
            break
        sample = draw.choice(samples)
        whole = sample.path.read_bytes()
        what, data = damaged(whole, draw, text=sample.path.suffix in (".yaml", ".json"))
        sample.path.write_bytes(data)
        error: BaseException | None = None
        try:
            sample.load()
        except Exception as caught:
            error = caught
        finally:
            sample.path.write_bytes(whole)
        found.note(sample.kind, what, error)
    return found


def damaged(data: bytes, draw: random.Random, text: bool) -> tuple[str, bytes]:
    """What was done, and the result."""
    ways = [_flip, _cut, _repeat, _insert, _remove]
    if text:
        ways += [_value, _value, _value, _key, _lines]
    for _ in range(draw.choice([1, 1, 1, 2, 4])):
        way = draw.choice(ways)
        data = way(data, draw)
    return way.__name__.strip("_"), data


def make_samples(folder: Path) -> list[Sample]:
    """Good files of every kind, in ``folder``, each loadable."""
    folder.mkdir(parents=True, exist_ok=True)
    samples = [_configuration(folder), *_maps(folder), *_checkpoint(folder)]
    for path in sorted((REPOSITORY_CONFIGS / "scenarios").glob("*.yaml"), key=by_number):
        if "kind: map" not in path.read_text("utf-8"):
            copy = folder / f"scenario-{path.name}"
            shutil.copyfile(path, copy)
            samples.append(Sample("scenario", copy, _loading(load_scenario, str(copy))))
    for sample in samples:
        sample.load()
    return samples


def _loading(load: Callable[[Any], Any], argument: Any) -> Callable[[], Any]:
    return lambda: load(argument)


def _configuration(folder: Path) -> Sample:
    path = folder / "config.yaml"
    path.write_text(load_config(REPOSITORY_CONFIGS / "lndrl.yaml").to_yaml(), encoding="utf-8")
    return Sample("configuration", path, _loading(load_config, path))


def _maps(folder: Path) -> list[Sample]:
    """A room of 24 x 16 pixels as PGM and PNG with their YAML files."""
    pixels = np.full((16, 24), 254, np.uint8)
    pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1] = 0, 0, 0, 0
    pixels[5:8, 5:8], pixels[2, 2] = 0, 205
    samples = []
    for kind, mode, yaw in (("pgm", "trinary", 0.0), ("png", "scale", 0.3)):
        image = folder / f"map.{kind}"
        Image.fromarray(pixels).save(image, format="PPM" if kind == "pgm" else "PNG")
        path = folder / f"map-{kind}.yaml"
        path.write_text(
            f"image: {image.name}\nresolution: 0.1\norigin: [-1.0, 2.0, {yaw}]\nnegate: 0\n"
            f"occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: {mode}\n",
            encoding="utf-8",
        )
        load = _loading(load_ros_map, path)
        samples += [Sample("map", path, load), Sample("map image", image, load)]
    return samples


def _checkpoint(folder: Path) -> list[Sample]:
    """The files of a checkpoint of a tiny network."""
    # The one room that is looked into: its loader is what is tested.
    from learner.ppo.update import PPO
    from learner.run.checkpoint import Counters, load_checkpoint, save_checkpoint

    data = load_config(REPOSITORY_CONFIGS / "lndrl.yaml").model_dump(mode="json")
    for section, values in SMALL.items():
        data[section] |= values
    ppo = PPO(parse_config(data, "small"))
    roster = {"actors": {"a": 0}, "sequences": [["a", "x", 3, [5]]]}
    path = save_checkpoint(folder / "checkpoints", ppo, Counters(64, 1, 1), roster, 3)
    load = _loading(lambda where: load_checkpoint(where, ppo), path)
    samples = [Sample("checkpoint", file, load) for file in sorted(path.iterdir())]
    policy = folder / "policy.safetensors"
    shutil.copyfile(path / "policy.safetensors", policy)
    return [*samples, Sample("policy", policy, _loading(load_policy, policy))]


# -- damage -------------------------------------------------------------------------------------


def _flip(data: bytes, draw: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(draw.randint(1, 10) if data else 0):
        # The beginning of a file is where its structure is.
        limit = draw.choice([min(64, len(data)), min(2000, len(data)), len(data)])
        changed[draw.randrange(limit)] = draw.randrange(256)
    return bytes(changed)


def _cut(data: bytes, draw: random.Random) -> bytes:
    return data[: draw.randrange(len(data) + 1)]


def _repeat(data: bytes, draw: random.Random) -> bytes:
    start = draw.randrange(len(data) + 1)
    return data[:start] + data[start : start + draw.randint(1, 200)] * draw.randint(2, 20) + data


def _insert(data: bytes, draw: random.Random) -> bytes:
    place = draw.randrange(len(data) + 1)
    return data[:place] + draw.randbytes(draw.randint(1, 50)) + data[place:]


def _remove(data: bytes, draw: random.Random) -> bytes:
    place = draw.randrange(len(data) + 1)
    return data[:place] + data[place + draw.randint(1, 50) :]


def _value(data: bytes, draw: random.Random) -> bytes:
    """One value of a text file replaced by a strange one."""
    places = list(re.finditer(rb"(?<=[:,\[\-] )[^\n,\]\[{}]+", data))
    if not places:
        return data
    place = draw.choice(places)
    return data[: place.start()] + draw.choice(STRANGE).encode() + data[place.end() :]


def _key(data: bytes, draw: random.Random) -> bytes:
    places = list(re.finditer(rb"[A-Za-z_\"]+(?=:)", data))
    if not places:
        return data
    place = draw.choice(places)
    new = draw.choice(
        [b"surprise", b"1", b"[a]", b"? x", b"<<", data[place.start() : place.end() - 1]]
    )
    return data[: place.start()] + new + data[place.end() :]


def _lines(data: bytes, draw: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    draw.shuffle(lines)
    return b"".join(lines)
