"""Settings that every test shares, made before numpy and torch are imported."""

from __future__ import annotations

import os

# Tests run beside each other; more threads each would only slow all of them down.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ.setdefault("MPLBACKEND", "Agg")

from hypothesis import HealthCheck, settings  # noqa: E402

# No deadline: the first example compiles the kernel. Derandomized: a red test is red again.
settings.register_profile(
    "lndrl", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("lndrl")
