"""Uploads made up by chaos are such as an honest actor of the run could send."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.chaos.forged import forged_arrays
from lndrl.navigation import Trajectory
from tests.learner.helpers_learner import small_config


@pytest.mark.parametrize("teacher", [None, "predictive"])
@pytest.mark.parametrize("critic", [False, True])
def test_a_learner_takes_what_is_forged(teacher: str | None, critic: bool) -> None:
    config = small_config(ppo={"teacher": teacher}, learner={"privileged_critic": critic})
    arrays = forged_arrays(config, np.random.default_rng(1), worlds=3)
    read = Trajectory.from_arrays(arrays, config)
    assert read.worlds == 3
    assert (read.teacher is not None) == (teacher is not None)
    assert (read.privileged is not None) == critic
