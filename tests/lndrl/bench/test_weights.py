"""How the effect of rounded weights is counted."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.bench.weights import effect


def test_the_same_answers_have_no_effect() -> None:
    answers = np.log(np.array([[0.7, 0.2, 0.1], [0.2, 0.3, 0.5]]))
    found = effect(answers, answers)
    assert (found["likeliest_agrees"], found["ratio_most"]) == (1.0, 1.0)
    assert found["kl"] == found["total_variation_mean"] == found["total_variation_most"] == 0.0


def test_what_is_apart_is_counted() -> None:
    whole = np.log(np.array([[0.5, 0.5 - 1e-9, 1e-9], [0.2, 0.3, 0.5]]))
    rounded = np.log(np.array([[0.4, 0.6 - 1e-9, 1e-9], [0.2, 0.3, 0.5]]))
    found = effect(whole, rounded)
    assert found["likeliest_agrees"] == 0.5 and found["observations"] == 2
    assert found["total_variation_most"] == pytest.approx(0.1)
    assert found["total_variation_mean"] == pytest.approx(0.05)
    assert found["kl"] == pytest.approx(0.5 * 0.5 * np.log(0.5 / 0.4 * 0.5 / 0.6))
    assert found["ratio_most"] in (pytest.approx(0.5 / 0.4), pytest.approx(0.6 / 0.5))
