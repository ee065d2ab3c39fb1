"""What a shell completes beyond commands and options: names that come with the program, and keys.

What begins like no name is left to the shell, which completes files.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

if TYPE_CHECKING:
    from lndrl.config import Kind


def complete_configuration(incomplete: str) -> list[str]:
    """Names of configurations."""
    return _names("configuration", incomplete)


def complete_shown(incomplete: str) -> list[str]:
    """Names of whatever ``lndrl config show`` shows, configurations first."""
    from lndrl.config import Kind

    return [name for kind in get_args(Kind) for name in _names(kind, incomplete)]


def complete_scenario(incomplete: str) -> list[str]:
    """Names of scenarios."""
    return _names("scenario", incomplete)


def complete_sweep(incomplete: str) -> list[str]:
    """Names of sweeps."""
    return _names("sweep", incomplete)


def complete_key(incomplete: str) -> list[str]:
    """Dotted keys of a configuration."""
    from lndrl.config import keys

    return [key for key in keys() if key.startswith(incomplete)]


def complete_setting(incomplete: str) -> list[str]:
    """``KEY=`` for keys that hold a value."""
    from lndrl.config import keys

    return [f"{name}=" for name, k in keys().items() if k.is_value and name.startswith(incomplete)]


def _names(kind: Kind, incomplete: str) -> list[str]:
    from lndrl.config import shipped

    return [name for name in shipped(kind) if name.startswith(incomplete)]
