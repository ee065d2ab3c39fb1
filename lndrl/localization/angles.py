"""Angles for compiled kernels: wrapping, differences, and a sine-cosine pair that vectorises.

The mathematics library's ``sin`` and ``cos`` are opaque calls, which stop the compiler from
working on several particles at once; the polynomials below (Cephes ``sin.c``, S. Moshier) do not.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from lndrl.kernels import kernel

TURN = 2.0 * math.pi


@kernel(_nrt=False, error_model="numpy")
def wrap(angle):
    """``angle`` (rad) shifted by whole turns into [-pi, pi)."""
    wrapped = angle - TURN * np.floor((angle + math.pi) / TURN)
    # Rounding can land exactly on +pi, which belongs to the other end.
    return wrapped if wrapped < math.pi else -math.pi


@kernel(_nrt=False, error_model="numpy")
def difference(a, b):
    """Shortest signed turn (rad, in [-pi, pi)) that leads from ``b`` to ``a``."""
    return wrap(a - b)


@njit(inline="always")
def sincos(angle):
    """Sine and cosine of ``angle`` (rad), within 1e-14 for |angle| < 100.

    Inlined into callers that loop over particles; no branch depends on data, so those vectorise.
    """
    quarters = angle * 0.6366197723675814
    k = np.int32(quarters + math.copysign(0.5, quarters))
    r = angle - k * 1.5707963267948966
    z = r * r
    p = -2.50507477628578072866e-8 + z * 1.58962301576546568060e-10
    p = -1.98412698295895385996e-4 + z * (2.75573136213857245213e-6 + z * p)
    sine = r + r * z * (-1.66666666666666307295e-1 + z * (8.33333333332211858878e-3 + z * p))
    q = 2.08757008419747316778e-9 + z * -1.13585365213876817300e-11
    q = 2.48015872888517045348e-5 + z * (-2.75573141792967388112e-7 + z * q)
    q = 4.16666666666665929218e-2 + z * (-1.38888888888730564116e-3 + z * q)
    cosine = 1.0 - 0.5 * z + z * z * q
    swap = (k & 1) != 0
    s = cosine if swap else sine
    c = sine if swap else cosine
    s = -s if (k & 2) != 0 else s
    c = -c if ((k + 1) & 2) != 0 else c
    return s, c
