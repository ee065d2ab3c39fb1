"""The task as Gymnasium environments: one world, and many worlds in one compiled step."""

from lndrl.navigation.environment.single import NavigationEnv
from lndrl.navigation.environment.spaces import ObservationDict
from lndrl.navigation.environment.vector import NavigationVectorEnv

__all__ = ["NavigationEnv", "NavigationVectorEnv", "ObservationDict"]
