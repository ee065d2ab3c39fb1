"""Where a scanner sits and what of its readings is an echo."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from lndrl.localization import Scanner


def test_bearings_are_those_of_the_base() -> None:
    level = Scanner(yaw=0.5)
    assert level.bearings(-1.0, 0.25, 3) == pytest.approx([-0.5, -0.25, 0.0])
    # Hung upside down it turns the other way round, as seen from above.
    hung = Scanner(yaw=0.5, upside_down=True)
    assert hung.bearings(-1.0, 0.25, 3) == pytest.approx([1.5, 1.25, 1.0])


def test_an_upside_down_scanner_sees_the_same_points() -> None:
    points = np.array([[1.0, 2.0], [3.0, -1.0], [-2.0, 0.5]])
    for scanner in (Scanner(yaw=0.3), Scanner(yaw=0.3, upside_down=True)):
        # In the scanner's own frame, whose y axis is mirrored where it hangs.
        c, s = math.cos(scanner.yaw), math.sin(scanner.yaw)
        own = points @ np.array([[c, -s], [s, c]])
        own[:, 1] *= -1.0 if scanner.upside_down else 1.0
        angles = np.arctan2(own[:, 1], own[:, 0])
        ranges = np.hypot(*own.T)
        for k in range(3):
            bearing = scanner.bearings(float(angles[k]), 0.1, 1)[0]
            seen = ranges[k] * np.array([math.cos(bearing), math.sin(bearing)])
            assert seen == pytest.approx(points[k], abs=1e-5)


def test_what_is_no_echo_becomes_the_maximum() -> None:
    scanner = Scanner(range_min=0.15, range_max=8.0)
    readings = [0.0, 0.15, 0.16, 7.99, 8.0, 9.0, math.inf, -1.0, math.nan]
    clean = scanner.echoes(np.array(readings))
    assert clean.dtype == np.float32
    assert clean[:-1] == pytest.approx([8.0, 8.0, 0.16, 7.99, 8.0, 8.0, 8.0, 8.0])
    assert math.isnan(clean[-1])
    assert scanner.echoes(np.array([5.0, 6.0]), farthest=6.0) == pytest.approx([5.0, 8.0])
    assert Scanner().echoes(np.array([0.0]))[0] == 0.0  # no minimum: it is an echo


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"x": math.nan}, "must be finite"),
        ({"range_max": math.inf}, "must be finite"),
        ({"range_min": 2.0, "range_max": 2.0}, "range_max 2 m must be above range_min 2 m"),
        ({"range_max": 0.0}, "above range_min -1 m and 0"),
    ],
)
def test_an_impossible_scanner_is_refused(keys: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Scanner(**keys)
