"""A training that a benchmark watches: what it says when it ends by itself."""

from __future__ import annotations

from pathlib import Path

import pytest

from lndrl.bench.training import Training
from lndrl.errors import UserError


def test_a_run_that_ends_early_is_quoted(tmp_path: Path) -> None:
    wrong = ["--set", "ppo.epochs=0"]
    with (
        Training("bench train", tmp_path, "tcp", wrong) as training,
        pytest.raises(UserError, match=r"^bench train: the run ended early, saying: .*ppo\.epochs"),
    ):
        training.wait(lambda rows: False, 0.05)
