"""From what a user types to a planner: a rule, a run folder, weights, or a class of one's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from lndrl.config import RunConfig
from lndrl.config.shipped import SHIPPED_POLICIES, SHIPPED_POLICY
from lndrl.errors import UserError
from lndrl.extensions import PLANNER, PartSettings, find, installed, is_own
from lndrl.models import TEMPERATURES, Model, validate
from lndrl.planners.careful import CarefulConfig, CarefulPlanner
from lndrl.planners.careful_map import CarefulMapConfig, CarefulMapPlanner
from lndrl.planners.dwa import DWAConfig, DWAPlanner
from lndrl.planners.guard import GuardConfig, GuardedPlanner
from lndrl.planners.interface import Planner
from lndrl.planners.own import OwnPlanner
from lndrl.planners.predictive import PredictiveConfig, PredictivePlanner
from lndrl.planners.shield import ShieldConfig, ShieldedPlanner, check_shield
from lndrl.planners.simple import RandomPlanner, StraightPlanner

RULES: dict[str, Callable[..., Planner]] = {
    RandomPlanner.name: RandomPlanner,
    StraightPlanner.name: StraightPlanner,
    DWAPlanner.name: DWAPlanner,
    PredictivePlanner.name: PredictivePlanner,
    CarefulPlanner.name: CarefulPlanner,
    CarefulMapPlanner.name: CarefulMapPlanner,
}
"""Planners that need no weights: two floors, the classical baseline, and one that looks ahead.
Called with a configuration, and those of PARAMETERS with their parameters."""

PARAMETERS: dict[str, type[Model]] = {
    DWAPlanner.name: DWAConfig,
    PredictivePlanner.name: PredictiveConfig,
    CarefulPlanner.name: CarefulConfig,
    CarefulMapPlanner.name: CarefulMapConfig,
}
"""What can be set of a rule; the others have nothing to set."""


@dataclass(frozen=True)
class PlannerSource:
    """Everything that a planner is built from; picklable, so that workers build the same one.

    ``config`` and ``weights`` are those that were trained together, None for a rule. A run
    that goes on training meanwhile changes neither. ``parameters`` are a rule's, of the kind in
    PARAMETERS, where they are not the defaults. ``own``: the name is that of a user's class, which
    gets ``settings``; it is imported where it is built, not before. ``temperature`` is that of a
    policy whose actions are sampled, see ``PolicyPlanner``. ``origin``: which policy of a run it
    is, see ``PolicyFile``. ``shield``: what keeps a policy from touching people, None for a policy
    on its own; ``guard``: what stops any planner before it could touch somebody.
    """

    name: str
    config: RunConfig | None = None
    weights: bytes | None = None
    parameters: Model | None = None
    own: bool = False
    settings: PartSettings = field(default_factory=dict)
    temperature: float = 1.0
    origin: str = ""
    shield: ShieldConfig | None = None
    guard: GuardConfig | None = None

    def at_temperature(self, temperature: float) -> PlannerSource:
        """The same, sampled at ``temperature``; raises UserError where that is none, or there is
        no policy to sample from.
        """
        least, most = TEMPERATURES
        if not least <= temperature <= most:
            raise UserError(
                f"temperature {temperature:g} must be from {least:g} to {most:g}; 1 samples as in "
                "training, below prefers likelier actions, and greedy takes the likeliest"
            )
        if self.weights is None:
            raise UserError(f"{self.name}: has no policy to sample at temperature {temperature:g}")
        return replace(self, temperature=temperature)

    @property
    def title(self) -> str:
        """What it is called where people read it: its name, and whether it has shield or guard."""
        return f"{self.name}{self._layers}"

    @property
    def label(self) -> str:
        """A short name, fit for a file's."""
        if self.own:
            return self.name.rpartition(":")[2] + self._layers
        if self.weights is None or self.name in SHIPPED_POLICIES:
            return f"{self.name}{self._layers}"
        path = Path(self.name).resolve()
        return f"{path.name if path.is_dir() else path.parent.name}{self._layers}"

    @property
    def _layers(self) -> str:
        return ("" if self.shield is None else "+shield") + ("" if self.guard is None else "+guard")

    def build(self, config: RunConfig, greedy: bool = False) -> Planner:
        """The planner for episodes under ``config``.

        ``greedy`` takes the likeliest action instead of sampling; rules ignore it. Raises
        UserError when the weights are for another observation layout than that of ``config``, or
        do not fit its networks, and for a class that this process does not trust.
        """
        planner = self._build(config, greedy)
        return planner if self.guard is None else GuardedPlanner(planner, config, self.guard)

    def _build(self, config: RunConfig, greedy: bool) -> Planner:
        """The planner without its guard."""
        if self.own:
            return OwnPlanner(self.name, config, self.settings)
        if self.parameters is not None:
            return RULES[self.name](config, self.parameters)
        if self.weights is None:
            return RULES[self.name](config)
        from lndrl.planners.policy import PolicyPlanner
        from lndrl.policy import check_layout

        if self.config is not None:
            check_layout(self.name, self.config, config)

        planner = PolicyPlanner.load(self.name, config, self.weights, greedy, self.temperature)
        return planner if self.shield is None else ShieldedPlanner(planner, config, self.shield)


def planner_source(
    spec: str,
    settings: PartSettings | None = None,
    *,
    checkpoint: str | None = None,
    shield: ShieldConfig | None = None,
    guard: GuardConfig | None = None,
) -> PlannerSource:
    """Find a rule, a run folder, a weights file, or name a class of one's own (not yet imported).

    ``shipped`` is the policy that comes with the program. ``settings`` go to such a class, or are
    parameters of a rule; ``checkpoint`` is which one of a run, by default the best validated one,
    else the newest; ``shield`` goes with a policy, which is sampled at the temperature that its
    file says; ``guard`` goes with all of them. Raises UserError when ``spec`` is none of them,
    weights cannot be read, a rule has no such parameter, there are settings for what takes none, or
    a shield for what ranks no actions or sees no people.
    """
    if shield is not None and is_rule(spec):
        raise UserError(
            f"{spec}: ranks no actions that a shield could choose among; it goes with policies: "
            f"{SHIPPED_POLICY}, a run folder or a weights file"
        )
    if is_own_planner(spec):
        return PlannerSource(spec, own=True, settings=settings or {}, guard=guard)
    if settings and not takes_settings(spec):
        raise UserError(
            f"{spec}: takes no settings; {', '.join(PARAMETERS)} and a planner of your own do "
            "(module:Class)"
        )
    if spec in RULES:
        find(PLANNER, spec, RULES)  # says so where a package installs another of that name
        parameters = validate(PARAMETERS[spec], settings, spec) if settings else None
        return PlannerSource(spec, parameters=parameters, guard=guard)
    if spec in installed(PLANNER):
        raise UserError(
            f"{spec}: is a path here and an installed planner; write ./{spec} or module:Class"
        )
    if not has_weights(spec):
        raise UserError(
            f"{spec}: no such run folder or weights file; give one, {SHIPPED_POLICY}, "
            f"{' or '.join(planner_names())}, or module:Class for a planner of your own"
        )
    from lndrl.policy import read_policy  # whose kernels rules do without

    found = read_policy(spec, checkpoint)
    if shield is not None:
        check_shield(spec, found.config)
    return PlannerSource(
        spec, found.config, found.weights,
        temperature=found.temperature, origin=found.origin, shield=shield, guard=guard,
    )  # fmt: skip


def teacher_of(config: RunConfig) -> PredictivePlanner:
    """The planner that ``config.ppo.teacher`` names, with ``config.imitation.settings``.

    Raises UserError for parameters that it does not have and a task that it cannot serve.
    """
    name, settings = config.ppo.teacher, dict(config.imitation.settings)
    where = f"imitation.settings of the teacher {name}"
    if name == CarefulPlanner.name:
        return CarefulPlanner(config, validate(CarefulConfig, settings, where))
    if name == PredictivePlanner.name:
        return PredictivePlanner(config, validate(PredictiveConfig, settings, where))
    raise UserError(f"ppo.teacher {name}: no planner of that name gives costs")


def has_weights(planner: str) -> bool:
    """Whether there is something to load a policy from under the name or path ``planner``."""
    return planner in SHIPPED_POLICIES or Path(planner).exists()


def planner_names() -> tuple[str, ...]:
    """Planners that need no weights: the rules, and what packages install."""
    return (*RULES, *(name for name in installed(PLANNER) if name not in RULES))


def is_own_planner(planner: str) -> bool:
    """Whether ``planner`` names a class of a user's own."""
    if planner in RULES or planner in SHIPPED_POLICIES:
        return False
    return is_own(planner) or (planner in installed(PLANNER) and not Path(planner).exists())


def takes_settings(planner: str) -> bool:
    """Whether something can be set of ``planner``: a rule with parameters, or a class."""
    return planner in PARAMETERS or is_own_planner(planner)


def is_rule(planner: str) -> bool:
    """Whether ``planner`` drives without weights."""
    return planner in RULES or is_own_planner(planner)


def make_planner(spec: str, config: RunConfig | None = None, greedy: bool = False) -> Planner:
    """Planner for ``spec`` under ``config``, by default the one its weights were trained with.

    Raises UserError as ``planner_source`` does, and for a rule without ``config``.
    """
    source = planner_source(spec)
    chosen = config or source.config
    if chosen is None:
        raise UserError(f"planner {spec!r} has no configuration of its own; give one")
    return source.build(chosen, greedy)
