"""What a sweep is: a base configuration, variants of it, seeds; from YAML and checked whole."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, field_validator

from lndrl.config import DEFAULTS, RunConfig, find, load_config
from lndrl.config.shipped import SHIPPED_POLICIES
from lndrl.errors import UserError
from lndrl.models import Count, Model, load_yaml, validate
from lndrl.numbering import checkpoints_in

BASE = "base"
"""Name of the variant that changes nothing."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_FIXED = {
    "seed": "name them in seeds",
    "learner.total_steps": "say steps",
    "transport.endpoint": "every run gets a port of its own",
    "learner.start": "say start",
    "learner.patience": "runs are compared at equal steps",
}
# Runs are compared at equal steps and tested at their end; an evaluator would only take time.
_EQUAL = ("learner.validation_episodes=0", "learner.patience=0")

Seed = Annotated[int, Field(ge=0)]


class VariantSpec(Model):
    """One deviation from the base."""

    set: list[str] = Field(min_length=1, description="key=value, as --set of lndrl train")
    why: str = Field(min_length=1, description="one line: what it would tell")

    @field_validator("why")
    @classmethod
    def _one_line(cls, why: str) -> str:
        if "\n" in why.strip():
            raise ValueError("must be one line")
        return why.strip()


class SweepSpec(Model):
    """A sweep's file."""

    config: str = Field(
        DEFAULTS["configuration"],
        description="the base: a name, or a file relative to this one or to the working folder",
    )
    set: list[str] = Field([], description="key=value for every run, the base's too")
    start: str | None = Field(
        None,
        description="run folder whose networks every run begins with, from the working folder; a "
        "policy file, or shipped, gives the policy alone",
    )
    steps: Count = Field(description="environment steps per run")
    seeds: list[Seed] = Field(min_length=1, description="every variant is trained under each")
    episodes: Annotated[int, Field(ge=0)] = Field(
        0, description="test episodes of every final policy; 0: none"
    )
    greedy: bool = Field(False, description="test the likeliest action instead of sampling")
    serial: bool = Field(False, description="one process per run: same bits every time")
    variants: dict[str, VariantSpec] = Field(
        min_length=1, description="changes by name; the base itself is trained, too"
    )

    @field_validator("seeds")
    @classmethod
    def _different(cls, seeds: list[int]) -> list[int]:
        if len(set(seeds)) != len(seeds):
            raise ValueError("a seed is named twice; each counts once")
        return seeds

    @field_validator("variants")
    @classmethod
    def _names(cls, variants: dict[str, VariantSpec]) -> dict[str, VariantSpec]:
        for name in variants:
            if name == BASE:
                raise ValueError(f"{BASE} is the variant that changes nothing; choose another name")
            if not _NAME.fullmatch(name):
                raise ValueError(f"{name!r} must be letters, digits, '.', '_' and '-'")
        return variants


@dataclass(frozen=True)
class Variant:
    """A configuration under a name; ``settings`` are its deviations from the base."""

    name: str
    settings: tuple[str, ...]
    why: str
    config: RunConfig

    @property
    def group(self) -> str:
        """The first key that it changes: variants of one key belong in one picture."""
        return self.settings[0].partition("=")[0] if self.settings else ""


@dataclass(frozen=True)
class PlannedRun:
    """One variant under one seed."""

    variant: Variant
    seed: int
    config: RunConfig

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.variant.name}-s{self.seed}"


@dataclass(frozen=True)
class Sweep:
    """A checked sweep; ``variants`` begin with the base."""

    name: str
    file: Path
    spec: SweepSpec
    variants: tuple[Variant, ...]

    def check_start(self) -> None:
        """Raise UserError where runs are to start from a run that left no checkpoint."""
        start = self.spec.start
        if start is None:
            return
        if start in SHIPPED_POLICIES or Path(start).is_file():
            from lndrl.policy import read_policy  # brings kernels along

            read_policy(start)
            return
        if not checkpoints_in(Path(start, "checkpoints")):
            raise UserError(f"{self.file}: start: {start} is no run folder with a checkpoint")

    def runs(self) -> list[PlannedRun]:
        """All runs, seed by seed: wherever a sweep stops, its variants are about as far."""
        return [
            PlannedRun(variant, seed, variant.config.model_copy(update={"seed": seed}))
            for seed in self.spec.seeds
            for variant in self.variants
        ]


def load_sweep(file: Path) -> Sweep:
    """Read ``file`` and every configuration that it asks for.

    Raises UserError naming file, variant and key, also for a variant that equals another.
    """
    if not _NAME.fullmatch(file.stem):
        raise UserError(f"{file}: the name must be letters, digits, '.', '_' and '-'")
    spec = validate(SweepSpec, load_yaml(file), str(file))
    try:
        base = find("configuration", spec.config, file.parent)
    except UserError as error:
        raise UserError(f"{file}: config: {error}") from None
    variants = [_variant(file, spec, base, BASE, (), "the configuration as it is")]
    for name, each in spec.variants.items():
        variant = _variant(file, spec, base, name, tuple(each.set), each.why)
        for other in variants:
            if other.config == variant.config:
                raise UserError(f"{file}: variant {name} is the same configuration as {other.name}")
        variants.append(variant)
    sweep = Sweep(file.stem, file, spec, tuple(variants))
    names = [run.name for run in sweep.runs()]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"{file}: two runs would be called {name}; rename a variant")
    return sweep


def _whole(start: str) -> str:
    return start if start in SHIPPED_POLICIES else str(Path(start).resolve())


def _variant(
    file: Path, spec: SweepSpec, base: Path, name: str, settings: tuple[str, ...], why: str
) -> Variant:
    overrides = [*spec.set, *settings]
    # Runs work in a folder of their own.
    start = [f"learner.start={_whole(spec.start)}"] if spec.start else []
    where = f"{file}: variant {name}"
    for override in overrides:
        key = override.partition("=")[0]
        if key in _FIXED:
            raise UserError(f"{where}: {override} is not for a variant to set; {_FIXED[key]}")
    try:
        config = load_config(
            base, [*_EQUAL, *overrides, *start, f"learner.total_steps={spec.steps}"]
        )
    except UserError as error:
        raise UserError(f"{where}: {error}") from None
    return Variant(name, settings, why, config)
