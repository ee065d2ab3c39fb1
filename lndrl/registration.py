"""The environment's name in Gymnasium, without importing Gymnasium before somebody else does.

Gymnasium reads no entry points since 1.0: who wants ``lndrl/Navigation-v0`` has to import this
package, in whatever order. Importing Gymnasium takes as long as the rest of a command's start, so
where it has not been imported yet the registration waits for it.
"""

from __future__ import annotations

import sys

ENVIRONMENT = "lndrl/Navigation-v0"
_REGISTRY = "gymnasium.envs.registration"


def register_environment() -> None:
    """Register ``lndrl/Navigation-v0``, once; imports Gymnasium, but nothing that simulates."""
    from gymnasium.envs import registration

    if ENVIRONMENT not in registration.registry:
        registration.register(
            id=ENVIRONMENT,
            entry_point="lndrl.navigation.environment:NavigationEnv",
            vector_entry_point="lndrl.navigation.environment:NavigationVectorEnv",
        )


def register_with_gymnasium() -> None:
    """``register_environment`` at once where Gymnasium is imported, else as soon as it is."""
    if _REGISTRY in sys.modules:
        register_environment()
    elif not any(getattr(finder, "environment", None) == ENVIRONMENT for finder in sys.meta_path):
        # Known by what it registers, not by its class: an installation has this file twice.
        sys.meta_path.insert(0, _Wait())


class _Wait:
    """Finds nothing itself; has the environment registered when Gymnasium's registry is loaded."""

    environment = ENVIRONMENT

    def find_spec(self, name, path=None, target=None):
        """See ``importlib.abc.MetaPathFinder``."""
        if name != _REGISTRY:
            return None
        from importlib.util import find_spec

        sys.meta_path.remove(self)
        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_register(module):
                load(module)
                # Where a wheel is installed, this runs in programs that have nothing to do with us:
                # a Gymnasium that we cannot register with must still be theirs.
                try:
                    register_environment()
                except Exception as error:
                    _say_unregistered(error)

            try:
                spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
            except AttributeError as error:  # a loader that cannot be wrapped
                _say_unregistered(error)
        return spec


def _say_unregistered(error: Exception) -> None:
    import logging

    logging.getLogger("lndrl").warning(
        "Gymnasium does not take the environment %s (%s: %s); its versions from 1.2 on do",
        *(ENVIRONMENT, type(error).__name__, error),
    )
