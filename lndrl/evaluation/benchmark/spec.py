"""What the test bench tests: methods, scenarios, and the hashes that say it is the same bench."""

from __future__ import annotations

import difflib
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from lndrl.config import REPOSITORY_CONFIGS, RunConfig, load_config
from lndrl.config import find as find_file
from lndrl.errors import UserError
from lndrl.evaluation.runner import in_world_of
from lndrl.extensions import PLANNER, PartSettings, find, fingerprint
from lndrl.models import MOST, Model, Temperature, effective, load_yaml, validate
from lndrl.planners import (
    GuardConfig,
    PlannerSource,
    ShieldConfig,
    has_weights,
    is_rule,
    planner_source,
)

Localization = Literal["amcl", "perfect"]
BENCHMARK = REPOSITORY_CONFIGS / "benchmark.yaml"
KERNEL_REVISION = 1
"""Of the numbers that the world, the filter and the task come to under one configuration. Raised by
whoever changes them on purpose (tests hold stored episodes to it): what was measured before is then
another bench's, though no key says so."""
_BASE = REPOSITORY_CONFIGS / "lndrl.yaml"
DIGITS = 16
"""Of the digest of a policy file, by which episodes know their policy."""
_POLICY = re.compile(rf"[0-9a-f]{{{DIGITS}}}" r"(?: at ([0-9.e+-]+))?(?: shield (\{[^{}]*\}))?")
_GUARD = re.compile(r"(.*) guard (\{[^{}]*\})", re.DOTALL)


class Method(Model):
    """One row of the table."""

    planner: str = Field(
        description="a rule such as dwa, a run folder, a weights file, shipped, or module:Class"
    )
    settings: PartSettings = Field(
        default_factory=dict, description="keyword arguments of a planner of your own"
    )
    localization: Localization = Field("amcl", description="perfect hands out the truth")
    shield: bool | ShieldConfig = Field(
        False, description="whether a policy's touches are vetoed, or by which parameters"
    )
    guard: bool | GuardConfig = Field(
        False, description="whether commands go through the guard, or within which bounds"
    )
    temperature: Temperature | None = Field(
        None, description="of a policy's sampling; by default what its file says, or 1"
    )
    config: str | None = Field(
        None,
        description="configuration that lndrl train-all trains it with: a name, or a file relative "
        "to this one; by default METHOD.yaml beside this one",
    )
    seed: Annotated[int, Field(ge=0, le=MOST)] | None = Field(
        None, description="of its training; by default what its configuration says"
    )

    @property
    def shielded(self) -> ShieldConfig | None:
        """The shield of this row, None for none."""
        if isinstance(self.shield, ShieldConfig):
            return self.shield
        return ShieldConfig() if self.shield else None

    @property
    def guarded(self) -> GuardConfig | None:
        """The guard of this row, None for none."""
        if isinstance(self.guard, GuardConfig):
            return self.guard
        return GuardConfig() if self.guard else None


class BenchmarkSpec(Model):
    """``configs/benchmark.yaml``."""

    version: Annotated[int, Field(ge=1)] = Field(
        1, description="of the bench; results of two versions do not go into one table"
    )
    scenarios: list[str] = Field(min_length=1, description="places to test in, by name or file")
    seed: Annotated[int, Field(ge=0)] = Field(0, description="of the episodes, alike for all")
    set: list[str] = Field(
        default_factory=list, description="key=value, as --set of lndrl train, in all scenarios"
    )
    only: dict[str, list[str]] = Field(
        default_factory=dict, description="scenario to key=value, in it alone, after set"
    )
    kernel_revision: Annotated[int, Field(ge=1)] = Field(
        1, description="of the program's numbers that the frozen hashes are of (docs/bench.md)"
    )
    frozen: dict[str, str] = Field(
        default_factory=dict, description="scenario to the hash that it must have"
    )
    training: list[str] = Field(
        default_factory=list,
        description="key=value, as --set of lndrl train, in the training of all methods",
    )
    methods: dict[str, Method] = Field(min_length=1, description="rows of the table, by name")

    @model_validator(mode="after")
    def _known_places(self) -> BenchmarkSpec:
        for name in self.only:
            if name not in self.scenarios:
                raise ValueError(
                    f"only names {name}, none of the scenarios {', '.join(self.scenarios)}"
                )
        return self

    @model_validator(mode="after")
    def _rules_are_not_trained(self) -> BenchmarkSpec:
        for name, method in self.methods.items():
            for key in ("config", "seed"):
                if getattr(method, key) is not None and is_rule(method.planner):
                    raise ValueError(
                        f"methods.{name}.{key}: {method.planner} is a rule, nothing to train"
                    )
        return self

    @property
    def changes(self) -> dict[str, list[str]]:
        """What ``set`` and ``only`` mean for each scenario."""
        return {name: self.changes_in(name) for name in self.scenarios}

    def changes_in(self, scenario: str) -> list[str]:
        """What they mean in ``scenario``, also in one that is not the bench's: key=value."""
        return [*self.set, *self.only.get(scenario, [])]

    def config_of(self, name: str, folder: Path = REPOSITORY_CONFIGS) -> Path | None:
        """The configuration that method ``name`` is trained with.

        The one that it names, else ``NAME.yaml`` in ``folder``, else that of another method which
        shares its planner; None for a rule and where there is none of these. Raises UserError for a
        name or file that is not there.
        """
        for each in self.sharing(name):
            named = self.methods[each].config
            if named is not None:
                try:
                    return find_file("configuration", named, folder)
                except UserError as error:
                    raise UserError(f"config: {error}") from None
            if (folder / f"{each}.yaml").is_file():
                return folder / f"{each}.yaml"
        return None

    def config_name(self, name: str) -> str:
        """What ``config_of`` looks for, by name: that of ``name``, else of who shares its run.

        Where nobody names one it is ``name`` itself. Needs no file, so it also says of results of
        elsewhere which rows are trained alike.
        """
        named = (self.methods[each].config for each in self.sharing(name))
        return next((each for each in named if each is not None), name).removesuffix(".yaml")

    def seed_of(self, name: str, folder: Path = REPOSITORY_CONFIGS) -> int | None:
        """The seed that the bench trains method ``name`` with, None for its configuration's.

        As for ``config_of``, a method that says nothing of its training has that of another.
        """
        for each in self.sharing(name):
            method = self.methods[each]
            said = method.seed is not None or method.config is not None
            if said or (folder / f"{each}.yaml").is_file():
                return method.seed
        return None

    def sharing(self, name: str) -> list[str]:
        """Method ``name`` and then the others that test the same run; none where it is a rule."""
        planner = self.methods[name].planner
        if is_rule(planner):
            return []
        others = [o for o, each in self.methods.items() if each.planner == planner and o != name]
        return [name, *others]


@dataclass(frozen=True)
class Contender:
    """A method that can be tested: its planner has been found.

    ``identity`` is the rule's name, the digest of the weights, or of the file of a user's class;
    a policy's temperature and shield stand behind its digest, see ``policy_of``, and a guard last,
    see ``guard_of``.
    """

    name: str
    source: PlannerSource
    localization: Localization
    greedy: bool = False

    @property
    def identity(self) -> str:
        """What must not change while a table is filled."""
        guard = self.source.guard
        return self._driver if guard is None else f"{self._driver} guard {guard.model_dump_json()}"

    @property
    def _driver(self) -> str:
        """The identity without a guard."""
        if self.source.parameters is not None:
            return f"{self.source.name} {self.source.parameters.model_dump_json()}"
        if self.source.own:
            found = find(PLANNER, self.source.name)
            assert found is not None
            settings = json.dumps(self.source.settings, sort_keys=True)
            return f"{self.source.name} {fingerprint(found)} {settings}"
        if self.source.weights is None:
            return self.source.name
        digest = hashlib.sha256(self.source.weights).hexdigest()[:DIGITS]
        if self.temperature != 1.0:
            digest += f" at {self.temperature!r}"
        if self.source.shield is not None:
            digest += f" shield {self.source.shield.model_dump_json()}"
        return digest

    @property
    def temperature(self) -> float:
        """At which actions are sampled; 1 where they are not."""
        return 1.0 if self.greedy else self.source.temperature

    @property
    def actions(self) -> str:
        """How actions are chosen."""
        if self.source.weights is None:
            return "rule"
        return "greedy" if self.greedy else "sampled"


def guard_of(identity: str) -> tuple[str, GuardConfig | None]:
    """A ``Contender.identity`` without its guard, and the guard; None where it names none.

    Raises UserError for a guard of other bounds than there are.
    """
    found = _GUARD.fullmatch(identity)
    if found is None:
        return identity, None
    return found[1], validate(GuardConfig, json.loads(found[2]), "guard")


def policy_of(identity: str) -> tuple[float | None, ShieldConfig | None]:
    """Temperature and shield that a policy's ``Contender.identity`` names; None where it does not.

    Raises UserError for a shield of other parameters than there are.
    """
    found = _POLICY.fullmatch(identity)
    if found is None:
        return None, None
    temperature = None if found[1] is None else float(found[1])
    shield = None
    if found[2] is not None:
        shield = validate(ShieldConfig, json.loads(found[2]), "shield")
    return temperature, shield


def load_benchmark(path: Path = BENCHMARK) -> BenchmarkSpec:
    """Read the bench; raises UserError naming the file and key."""
    return validate(BenchmarkSpec, load_yaml(path), str(path))


def choose(known: Sequence[str], wanted: Sequence[str] | None, what: str) -> list[str]:
    """``wanted`` in its order, by default all of ``known``; raises UserError for others."""
    if wanted is None:
        return list(known)
    for name in wanted:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=2, cutoff=0.5)
            hint = f"did you mean {' or '.join(close)}? known" if close else "known"
            raise UserError(f"{what} {name!r} is unknown; {hint}: {', '.join(known)}")
    if not wanted:
        raise UserError(f"no {what} is named; known: {', '.join(known)}")
    return list(dict.fromkeys(wanted))


def contenders(
    spec: BenchmarkSpec,
    wanted: Sequence[str] | None = None,
    localization: Localization | None = None,
    greedy: bool = False,
    configs: Path = REPOSITORY_CONFIGS,
) -> tuple[list[Contender], list[str]]:
    """Methods that can be tested, and those without weights, by name.

    ``localization`` replaces every method's own. Raises UserError for an unknown method, for a
    missing planner where the method was asked for by name, and for weights of another observation
    layout than that of the method's configuration in ``configs`` or, without one, of the bench.
    """
    found: list[Contender] = []
    missing: list[str] = []
    for name in choose(list(spec.methods), wanted, "method"):
        method = spec.methods[name]
        found_none = not is_rule(method.planner) and not has_weights(method.planner)
        if found_none and wanted is None:
            missing.append(name)
            continue
        try:
            source = planner_source(
                method.planner, method.settings, shield=method.shielded, guard=method.guarded
            )
            if method.temperature is not None:
                source = source.at_temperature(method.temperature)
            _check_layout(source, spec.config_of(name, configs), spec.training)
        except UserError as error:
            raise UserError(f"method {name}: {error}") from None
        found.append(Contender(name, source, localization or method.localization, greedy))
    return found, missing


def _check_layout(source: PlannerSource, file: Path | None, training: Sequence[str]) -> None:
    if source.config is None:
        return
    from lndrl.policy import check_layout  # whose kernels a table does without

    if file is not None:
        check_layout(source.name, source.config, load_config(file, list(training)), shown(file))
    # What is left of a layout is the policy's own under the bench, see bench_config.
    seen = source.config.model_copy(update={"world": load_config(_BASE).world})
    check_layout(source.name, source.config, seen, "the bench")


def shown(file: Path) -> str:
    """``file`` from the working folder where it lies below, as a user would write it."""
    here = Path.cwd()
    return str(file.relative_to(here) if file.is_relative_to(here) else file)


def bench_config(
    contender: Contender, scenario: str, seed: int, changes: Sequence[str] = ()
) -> RunConfig:
    """What ``contender`` is tested under in ``scenario``.

    World, filter and task limits are the bench's own, whatever the policy was trained under; what
    the policy sees and does, and its networks, are those of its training. ``changes`` (key=value)
    make another bench, for calibration.
    """
    base = load_config(_BASE, [f"scenario={scenario}", *changes])
    localization = base.localization.model_copy(update={"kind": contender.localization})
    base = base.model_copy(update={"seed": seed, "localization": localization})
    return in_world_of(base, contender.source.config or base)


def bench_hash(config: RunConfig) -> str:
    """Twelve hex digits that change when the bench behaves otherwise in ``config``'s scenario.

    Whatever it is that changes: the scenario, the world's defaults, the filter's, the task's
    limits, the numbers that the kernels come to. Later keys count where they change something (see
    ``effective``). The localization's kind is left out: it is a property of the method.
    """
    task = config.task
    parts: dict[str, Any] = {
        "scenario": effective(config.scenario),
        "world": effective(config.world),
        "localization": {k: v for k, v in effective(config.localization).items() if k != "kind"},
        "task": [task.arrive_distance, task.lost_distance, task.lost_angle, task.time_limit],
    }
    if config.localization.delay and task.judged_moment != "present":
        parts["judged_moment"] = task.judged_moment
    if KERNEL_REVISION != 1:
        parts["kernel_revision"] = KERNEL_REVISION
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:12]


def check_frozen(spec: BenchmarkSpec, hashes: Mapping[str, str]) -> None:
    """See that every scenario in ``hashes`` (name to hash) is the one that ``spec`` has frozen.

    Raises UserError: its results would stand in one table with those of another place.
    """
    if spec.kernel_revision != KERNEL_REVISION:
        raise UserError(
            f"the bench was frozen at kernel_revision {spec.kernel_revision}, this program's is "
            f"{KERNEL_REVISION}; use the program that it was frozen with, or freeze the new hashes "
            "and test every method anew"
        )
    for scenario, found in hashes.items():
        frozen = spec.frozen.get(scenario, found)
        if frozen != found:
            raise UserError(
                f"scenario {scenario} is not the bench's: its hash is {found}, frozen is {frozen}; "
                "undo what has changed of place, world, filter or task, or raise its version, "
                "freeze the new hash and test every method anew"
            )
