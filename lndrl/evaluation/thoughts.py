"""What a planner thought of in a moment, beside what a drawing of that moment needs."""

from __future__ import annotations

from dataclasses import replace

from lndrl.navigation import Navigation, WorldSnapshot
from lndrl.planners import GuardedPlanner, Planner, ShieldedPlanner
from lndrl.planners.policy import PolicyPlanner


def with_thoughts(world: Navigation, planner: Planner) -> WorldSnapshot:
    """A snapshot of ``world``, the only one that ``planner`` drives, with the two heaviest
    clusters and the probabilities of the actions; a rule has none.
    """
    policy: object = planner
    while isinstance(policy, ShieldedPlanner | GuardedPlanner):
        policy = policy.planner
    said = policy.probabilities[0] if isinstance(policy, PolicyPlanner) and world.steps else None
    return replace(world.snapshot(said), clusters=world.localization.cluster_places())
