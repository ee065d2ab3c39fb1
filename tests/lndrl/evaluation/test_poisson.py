from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import poisson

from lndrl.evaluation.poisson import poisson_interval


@given(st.integers(0, 400))
def test_each_bound_leaves_a_fortieth_outside(events: int) -> None:
    low, high = poisson_interval(events)
    assert poisson.cdf(events, high) == pytest.approx(0.025)
    if events:
        assert poisson.sf(events - 1, low) == pytest.approx(0.025)
    else:
        assert low == 0.0
    assert low <= events <= high


def test_published_values() -> None:
    # Garwood's table, as in Ulm, American Journal of Epidemiology 131 (1990).
    assert poisson_interval(0) == pytest.approx((0.0, 3.689), abs=1e-3)
    assert poisson_interval(10) == pytest.approx((4.795, 18.390), abs=1e-3)


def test_fewer_than_none_are_refused() -> None:
    with pytest.raises(ValueError, match="-1 events"):
        poisson_interval(-1)
