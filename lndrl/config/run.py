"""The whole run, and how it is read from YAML."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import Field, model_validator

from lndrl.config.imitation import ImitationConfig
from lndrl.config.learning import (
    BUILT_IN,
    ActorConfig,
    LearnerConfig,
    NetworkConfig,
    PPOConfig,
    TransportConfig,
)
from lndrl.config.localization import LocalizationConfig
from lndrl.config.shipped import find
from lndrl.config.task import TaskConfig
from lndrl.config.world import RandomizeConfig, ReplicaConfig, RetryConfig, WorldConfig
from lndrl.errors import UserError
from lndrl.models import LATER, MOST, Model, effective, load_yaml, validate
from lndrl.scenario import Scenario

FIXED_ACTORS = 2
"""What ``actor.count: auto`` means where a run must repeat on every machine."""
MOST_STEPS = 1_000_000
"""Of an episode: every world keeps its whole path, 32 bytes a step."""
MOST_WORLDS = 32
"""Rows of one inference beyond which a sample hardly gets cheaper on one core."""


class RunConfig(Model):
    """Everything that decides a run; the learner hands it to the actors."""

    seed: Annotated[int, Field(ge=0, le=MOST)] = Field(
        1, description="of every random draw: worlds, episodes, first weights, minibatches"
    )
    scenario: Scenario = Field(description="the place to train in: its name, a YAML file, or keys")
    world: WorldConfig = Field(WorldConfig(), description="the truth: clock, robot, laser, people")
    localization: LocalizationConfig = Field(
        LocalizationConfig(),
        description="the filter that says where the robot believes it is: a preset's name, or keys",
    )
    randomize: Annotated[RandomizeConfig, LATER] = Field(
        RandomizeConfig(), description="what is drawn anew for every episode of training"
    )
    retry: Annotated[RetryConfig, LATER] = Field(
        RetryConfig(), description="what a world does in training where an episode has failed"
    )
    replicas: Annotated[ReplicaConfig, LATER] = Field(
        ReplicaConfig(), description="filters beside the robot's own that show its chance of loss"
    )
    task: TaskConfig = Field(TaskConfig(), description="what the robot sees, does, is paid for")
    network: NetworkConfig = Field(NetworkConfig(), description="policy and value network")
    ppo: PPOConfig = Field(PPOConfig(), description="how an update learns from a batch")
    imitation: Annotated[ImitationConfig, LATER] = Field(
        ImitationConfig(), description="how ppo.teacher is learned from"
    )
    learner: LearnerConfig = Field(LearnerConfig(), description="the service that learns")
    actor: ActorConfig = Field(ActorConfig(), description="the services that simulate and act")
    transport: TransportConfig = Field(
        TransportConfig(), description="the network between learner, actors and dashboards"
    )

    @model_validator(mode="after")
    def _frames_need_their_encoder(self) -> RunConfig:
        network = self.network
        reads_one = network.scan_encoder == BUILT_IN and network.policy == BUILT_IN
        if self.task.scan_frames > 1 and reads_one:
            raise ValueError(
                f"task.scan_frames {self.task.scan_frames} needs network.scan_encoder: fan; "
                "the paper's reads one scan"
            )
        return self

    @model_validator(mode="after")
    def _episodes_fit_into_memory(self) -> RunConfig:
        if self.steps_limit > MOST_STEPS:
            raise ValueError(
                f"task.time_limit {self.task.time_limit:g} s has {self.steps_limit:,} control steps"
                f" of {self.world.ticks_per_step} x {self.world.tick:g} s; at most {MOST_STEPS:,}"
            )
        return self

    @model_validator(mode="after")
    def _filter_hears_the_steps_end(self) -> RunConfig:
        ticks, last = self.localization.update_ticks, self.world.ticks_per_step
        if ticks is not None and ticks[-1] != last:
            raise ValueError(
                f"localization.update_ticks {ticks} must end with {last}, the last tick of a step "
                "(world.ticks_per_step): what the robot hears then describes the step's end"
            )
        return self

    @model_validator(mode="after")
    def _a_round_does_not_grow(self) -> RunConfig:
        if self.learner.mode == "lockstep" and self.ppo.batch_size_final is not None:
            raise ValueError(
                "ppo.batch_size_final needs learner.mode: async; in lockstep a batch is a round, "
                "one chunk of every actor, and does not grow"
            )
        return self

    def teacher_misfit(self) -> str | None:
        """Why ``ppo.teacher`` cannot teach this task, and what would be right; None where it can.

        Not checked when read: what was trained with a teacher may be tested where it could not be.
        """
        if self.ppo.teacher == "careful" and self.localization.kind == "perfect":
            return (
                "ppo.teacher careful goes by the belief's variances, and localization perfect has "
                "none; take predictive, or localization.kind: amcl"
            )
        careful = self.ppo.teacher == "careful"
        if (
            self.imitation.vary > 0.0
            and careful
            and self.imitation.settings.get("hears_commands", True)
        ):
            return (
                "imitation.vary needs a teacher that goes by the observation alone; say "
                "hears_commands: false in imitation.settings"
            )
        if self.ppo.teacher and self.imitation.vary > 0.0 and self._velocities_take_time:
            return (
                "imitation.vary labels states that nobody met, in which nobody knows how fast the "
                "robot drives; with world.robot.acceleration say imitation.vary: 0"
            )
        turns = self.task.angular_velocities
        if self.ppo.teacher and self.imitation.mirror and {-w for w in turns} != set(turns):
            return (
                "imitation.mirror needs task.angular_velocities that go as far left as right; make "
                "them so, or set imitation.mirror: false"
            )
        return None

    @property
    def _velocities_take_time(self) -> bool:
        return any(math.isfinite(limit) for limit in self.world.robot.acceleration.limits)

    @property
    def steps_limit(self) -> int:
        """Control steps until an episode is truncated (parameters §4.6), at least 1."""
        step = self.world.tick * self.world.ticks_per_step
        return max(1, math.ceil(self.task.time_limit / step - 1e-9))

    def to_yaml(self) -> str:
        """The resolved configuration as YAML; ``load_config`` reads it back equal."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)

    @property
    def fixed_actors(self) -> int:
        """Actors of a serial or lock-step run: the same on every machine."""
        return FIXED_ACTORS if self.actor.count == "auto" else self.actor.count

    def worlds_per_actor(self, actors: int = FIXED_ACTORS) -> int:
        """Worlds of each of ``actors`` processes that work for one learner.

        Where ``actor.worlds`` is auto: at most half a batch per chunk, so that a batch is cut
        where it should; at most half of ``learner.max_lag`` batches in the chunks of all actors,
        because a chunk is about that many updates old when it has been collected; and not more
        than MOST_WORLDS. Where batches grow (``ppo.batch_size_final``), the first ones decide:
        later ones are made of more chunks, which are fewer updates old. Depends on ``actors`` but
        on nothing else of the machine, and in lock-step not even on that.
        """
        if self.actor.worlds != "auto":
            return self.actor.worlds
        if self.learner.mode == "lockstep":
            actors = self.fixed_actors
        age = max(1.0, self.learner.max_lag / 2)
        samples = self.ppo.batch_size * min(0.5, age / actors)
        return min(MOST_WORLDS, max(1, int(samples / self.actor.horizon)))

    def content_hash(self) -> str:
        """Twelve hex digits that change when any value changes; see ``effective``."""
        text = json.dumps(effective(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def load_scenario(name: str, beside: Path | None = None, seen: tuple[Path, ...] = ()) -> Scenario:
    """Scenario by name (``configs/scenarios/NAME.yaml``) or by path of a YAML file.

    A map that it names is read, so that the scenario is complete. The YAML file of a ROS map is a
    scenario, too: named like the file, all else as it is by default. ``seen`` are the files that
    led here as places of a mixture. Raises UserError naming the
    file and, for an unknown name, the known ones.
    """
    path = find("scenario", name, beside)
    if path.resolve() in seen:
        raise UserError(f"{path}: mixed.places leads back to itself")
    data = load_yaml(path)
    if "image" in data:
        data = _scenario_of_map(data, path)
    _resolve_places(data, path, str(path), (*seen, path.resolve()))
    return _with_map(validate(Scenario, data, str(path)), path)


def _scenario_of_map(data: dict[str, Any], path: Path) -> dict[str, Any]:
    """A scenario of the ROS map that the file ``path`` describes by ``data``."""
    both = sorted(set(data) & set(Scenario.model_fields) - {"resolution"})
    if both:
        raise UserError(
            f"{path}: is a map (image) and a scenario ({', '.join(both)}) at once; write the "
            f"scenario's keys into a file of its own beside it, with kind: map and "
            f"map: {path.name}"
        )
    return {"name": path.stem, "kind": "map", "map": path.name}


def _with_map(scenario: Scenario, path: Path) -> Scenario:
    """``scenario`` with its maps read; a relative path is relative to the file ``path``."""
    if scenario.mixed is not None:
        places = [
            part.model_copy(update={"scenario": _with_map(part.scenario, path)})
            for part in scenario.mixed.places
        ]
        mixed = scenario.mixed.model_copy(update={"places": places})
        return scenario.model_copy(update={"mixed": mixed})
    if scenario.kind != "map" or scenario.cells is not None:
        return scenario
    from lndrl.maps.embedded import with_map  # brings numba along

    try:
        return with_map(scenario, path.parent)
    except UserError as error:
        named = str(error).startswith(f"{path}:")  # a map that is its own scenario
        raise UserError(f"{error}" if named else f"{path}: {error}") from None


def load_config(named: Path | str, overrides: list[str] | tuple[str, ...] = ()) -> RunConfig:
    """Configuration from YAML with ``key=value`` overrides (dotted keys, YAML values).

    Text may be a name, such as ``lndrl``, a path or a run folder (see ``shipped.find``); a Path is
    read as it is. Raises UserError naming file, key and mend.
    """
    path = named if isinstance(named, Path) else find("configuration", named)
    data = _with_base(path)
    where = str(path) if not overrides else f"{path} with --set"
    for override in overrides:
        if override.startswith("scenario."):
            _resolve_scenario(data, path, where)  # its keys can be set once they are there
        _apply(data, override)
    _resolve_scenario(data, path, where)
    _resolve_places(data.get("scenario"), path, where)
    if data.get("scenario") is None:
        raise UserError(f"{where}: scenario is missing; name one, e.g. scenario: hybrid")
    config = validate(RunConfig, data, where)
    return config.model_copy(update={"scenario": _with_map(config.scenario, path)})


def _resolve_places(scenario: Any, path: Path, where: str, seen: tuple[Path, ...] = ()) -> None:
    """Put what the names of a mixture's places stand for in their place."""
    mixed = scenario.get("mixed") if isinstance(scenario, dict) else None
    places = mixed.get("places") if isinstance(mixed, dict) else None
    for part in places if isinstance(places, list) else ():
        if isinstance(part, dict) and isinstance(part.get("scenario"), str):
            try:
                part["scenario"] = load_scenario(part["scenario"], path.parent, seen).model_dump()
            except UserError as error:
                raise UserError(f"{where}: {error}") from None


def _resolve_scenario(data: dict[str, Any], path: Path, where: str) -> None:
    """Put what the scenario's name stands for in its place."""
    if isinstance(data.get("scenario"), str):
        try:
            data["scenario"] = load_scenario(data["scenario"], path.parent).model_dump()
        except UserError as error:
            raise UserError(f"{where}: {error}") from None


def _with_base(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    """The file's keys over those of the file that its ``base`` names, a path or a name."""
    data = load_yaml(path)
    base = data.pop("base", None)
    if base is None:
        return data
    if not isinstance(base, str):
        raise UserError(f"{path}: base must name a YAML file, e.g. base: lndrl.yaml")
    if path in seen:
        raise UserError(f"{path}: base leads back to itself")
    try:
        below = find("configuration", base, path.parent)
    except UserError as error:
        raise UserError(f"{path}: base: {error}") from None
    return _merged(_with_base(below, (*seen, path)), data)


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """``above`` over ``below``, mapping by mapping; an empty one, ``{}``, empties what is below."""
    both = {
        key: _merged(below[key], value)
        for key, value in above.items()
        if value and isinstance(value, dict) and isinstance(below.get(key), dict)
    }
    return {**below, **above, **both}


def parse_config(data: Any, where: str) -> RunConfig:
    """Configuration from plain data, e.g. received from a learner; raises UserError."""
    return validate(RunConfig, data, where)


def _apply(data: dict[str, Any], override: str) -> None:
    key, equals, value = override.partition("=")
    if not equals or not key:
        raise UserError(f"--set {override}: must be key=value, e.g. ppo.epochs=4")
    *parents, last = key.split(".")
    target = data
    for parent in parents:
        inner = target.setdefault(parent, {})
        if isinstance(inner, str) and parent in ("localization", "robot"):
            inner = target[parent] = {"preset": inner}
        if not isinstance(inner, dict):
            raise UserError(f"--set {override}: {parent} holds a value, not keys")
        target = inner
    try:
        target[last] = yaml.safe_load(value)
    except yaml.YAMLError:
        raise UserError(f"--set {override}: {value!r} is not a YAML value") from None
