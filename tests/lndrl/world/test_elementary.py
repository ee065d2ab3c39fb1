import numpy as np

from lndrl.world.elementary import angle_of, exp_minus


def test_exp_minus_is_the_exponential():
    x = np.concatenate([np.linspace(0, 23.99, 20_001), np.arange(0, 24, 1 / 32)])
    got = np.array([exp_minus(v) for v in x])
    assert np.abs(got / np.exp(-x) - 1.0).max() < 3e-10
    assert exp_minus(24.0) == exp_minus(1e300) == exp_minus(np.inf) == 0.0
    # Neither may become an index of the table.
    assert exp_minus(np.nan) == 0.0
    assert np.isfinite(exp_minus(-1e6))


def test_angle_of_is_arctan2():
    rng = np.random.default_rng(1)
    y, x = rng.normal(size=(2, 20_000)) * 10.0 ** rng.uniform(-6, 6, (2, 20_000))
    got = np.array([angle_of(*v) for v in zip(y, x, strict=True)])
    assert np.abs(got - np.arctan2(y, x)).max() < 1e-11
    for a, b in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (-1.0, 0.0), (1.0, 1.0), (-1.0, -1.0)):
        assert abs(angle_of(a, b) - np.arctan2(a, b)) < 1e-11
    assert angle_of(0.0, -1.0) == np.pi
