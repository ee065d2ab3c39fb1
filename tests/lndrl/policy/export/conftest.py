"""An exported policy for all who only look at one: torch takes seconds for each."""

from __future__ import annotations

import pytest

from lndrl.policy import initial_weights
from lndrl.policy.export import Exported, export_policy
from tests.lndrl.policy.export.rooms import FEW, made_config, weights_of


@pytest.fixture(scope="session")
def exported() -> Exported:
    """The policy of ``made_config()`` that has an opinion."""
    config = made_config()
    return export_policy(config, weights_of(config), "here", FEW, timed=0.01)


@pytest.fixture(scope="session")
def first_exported() -> Exported:
    """The first weights of the same network, which say nearly the same to everything."""
    config = made_config()
    return export_policy(config, initial_weights(config), "here", FEW, timed=0.01)
