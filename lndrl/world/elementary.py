"""Exponential and angle for compiled kernels: cheap, and the same bits on every machine.

Only additions, multiplications and one division, so no libm and no compiler decides the last bit.
"""

from __future__ import annotations

import numpy as np

from lndrl.kernels import kernel

NOTHING = 17.0
"""Exponent from which ``exp(-x)``, below 5e-8, is not worth computing where forces are O(1)."""

_STEPS = 32.0  # table entries per unit
_LAST = 24.0
_TABLE = np.exp(-np.arange(int(_LAST * _STEPS) + 1) / _STEPS)
_TAN_22_5 = 0.4142135623730951


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def exp_minus(x):
    """``exp(-x)`` for x >= 0, relative error below 3e-10; 0 from 24 on, and for NaN."""
    if not x < _LAST:
        return 0.0
    entry = max(int(x * _STEPS), 0)
    r = x - entry * (1.0 / _STEPS)
    return _TABLE[entry] * (1.0 - r * (1.0 - r * (0.5 - r * (1.0 / 6.0 - r * (1.0 / 24.0)))))


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def angle_of(y, x):
    """``arctan2(y, x)`` (rad) to 1e-11; 0 for the zero vector."""
    a, b = abs(x), abs(y)
    small, large = min(a, b), max(a, b)
    if large == 0.0:
        return 0.0
    base = 0.0
    if small > _TAN_22_5 * large:
        # tan(u - 45 deg) = (tan u - 1) / (tan u + 1)
        base = 0.25 * np.pi
        t = (small - large) / (small + large)
    else:
        t = small / large
    s = t * t
    # Minimax in odd powers on [-tan 22.5 deg, tan 22.5 deg], error 4e-12.
    poly = -0.08371970200966522 + s * 0.045567242463303875
    poly = -0.1427971544458008 + s * (0.11022365967982606 + s * poly)
    poly = -0.33333330063218125 + s * (0.19999789627882283 + s * poly)
    angle = base + t * (0.9999999998526153 + s * poly)
    if b > a:
        angle = 0.5 * np.pi - angle
    if x < 0.0:
        angle = np.pi - angle
    return -angle if y < 0.0 else angle
