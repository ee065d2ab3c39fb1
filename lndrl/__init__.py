"""Robots that learn to walk through crowds without losing track of where they are.

What a user's own program needs of the package stands here and is imported when it is first asked
for; importing the package alone only tells Gymnasium the environment's name, and numba where to
keep kernels if they have no place.
"""

from importlib import import_module

from lndrl.caches import settle
from lndrl.registration import register_with_gymnasium
from lndrl.version import VERSION

__version__ = VERSION

TYPE_CHECKING = False  # true for type checkers; importing typing would cost more than all here
if TYPE_CHECKING:
    from lndrl.config import RunConfig, load_config, load_scenario
    from lndrl.navigation.environment import NavigationEnv, NavigationVectorEnv
    from lndrl.planners.trained import TrainedPolicy, load_policy

_OFFERED = {
    "NavigationEnv": "lndrl.navigation.environment",
    "NavigationVectorEnv": "lndrl.navigation.environment",
    "RunConfig": "lndrl.config",
    "load_config": "lndrl.config",
    "load_scenario": "lndrl.config",
    "TrainedPolicy": "lndrl.planners.trained",
    "load_policy": "lndrl.planners.trained",
}
"""Where the names are that come late."""

__all__ = [
    "NavigationEnv",
    "NavigationVectorEnv",
    "RunConfig",
    "TrainedPolicy",
    "__version__",
    "load_config",
    "load_policy",
    "load_scenario",
]

settle()
register_with_gymnasium()


def __getattr__(name: str) -> object:
    if name not in _OFFERED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_OFFERED[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
