"""Low-variance draws: unbiased, evenly spread at every size, and fit for the KLD rule."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.localization.belief import make_field, make_scratch
from lndrl.localization.bins import bin_key, bin_keys, empty, make_bins
from lndrl.localization.likelihood import LikelihoodMap
from lndrl.localization.resampling import accumulate, kld_limits, resample
from lndrl.localization.systematic import locate, resample_systematic
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import stream_state

COUNT = 3000


class Setting:
    def __init__(self, spread, weights=None, **limits):
        rng = np.random.default_rng(4)
        self.config = LocalizationConfig(**{"max_particles": COUNT, **limits})
        yaw = rng.normal(1.0, spread, COUNT)
        x, y = rng.normal([[5.0], [4.0]], spread, (2, COUNT))
        # As a filter meets it: the set is sorted, one corner first.
        order = np.argsort(x)
        x, y, yaw = x[order], y[order], yaw[order]
        self.source = np.array([x, y, yaw, np.cos(yaw), np.sin(yaw)])
        self.weights = np.ones(COUNT) if weights is None else weights
        occupied = np.zeros((80, 100), dtype=bool)
        occupied[:, 50:] = True
        grid = OccupancyGrid(occupied, 0.1, (1.0, 2.0))
        self.field = make_field(LikelihoodMap.build(grid, self.config))
        self.scratch = make_scratch(self.config, LaserConfig(beams=10))
        self.bins = make_bins(self.config)
        self.limits = kld_limits(self.config)
        self.target = np.zeros((5, COUNT))
        bin_keys(self.source, COUNT, self.bins, self.scratch.keys)

    def run(self, seed, kernel=resample_systematic, chance=0.0):
        empty(self.bins)
        return kernel(
            self.source, self.weights, COUNT, self.target, self.scratch,
            self.bins, self.limits, chance, self.field, stream_state(seed),
        )  # fmt: skip

    def copies(self, count):
        return np.bincount(np.searchsorted(self.source[0], self.target[0, :count]), minlength=COUNT)


def test_locate_inverts_the_cumulative_weights():
    rng = np.random.default_rng(5)
    for count in (1, 2, 3, 100):
        values = rng.exponential(1.0, count) ** 3
        cumulative, guide = np.zeros(count), np.zeros(count, dtype=np.int32)
        total = accumulate(values, count, cumulative, guide)
        for u in rng.uniform(0, 1, 500):
            expected = min(np.searchsorted(cumulative, u * total, side="right"), count - 1)
            assert locate(cumulative, guide, count, total, u) == expected


def test_every_particle_has_its_share_and_hardly_scatters():
    weights = np.random.default_rng(6).exponential(1.0, COUNT) ** 2
    made = Setting(0.2, weights, min_particles=COUNT)
    share = COUNT * weights / weights.sum()
    runs = np.array([made.copies(made.run(seed)[0]) for seed in range(300)])
    independent = np.array([made.copies(made.run(seed, resample)[0]) for seed in range(300)])
    # Unbiased: the mean of 300 runs, in units of what an exact systematic sweep would scatter.
    deviation = np.sqrt((share % 1) * (1 - share % 1) / 300) + 1e-3
    assert np.abs((runs.mean(axis=0) - share) / deviation).mean() < 1.3
    assert np.abs(runs - share).max() < 3.0  # an independent draw of the heaviest: 15 and more
    assert runs.var(axis=0).mean() < 0.3 * independent.var(axis=0).mean()


@pytest.mark.parametrize("size", [37, 500, 1331])
def test_every_prefix_covers_the_whole_set(size):
    made = Setting(0.2)
    made.limits = np.full(size + 1, size, dtype=np.int32)
    assert made.run(3)[0] == size
    share = np.searchsorted(made.source[0], made.target[0, :size]) / COUNT
    counts = np.histogram(share, 10, (0, 1))[0]
    assert np.abs(counts - size / 10).max() <= 2


@pytest.mark.parametrize("spread", [0.02, 0.2, 0.6, 1.5])
def test_kld_stops_where_independent_draws_stop(spread):
    made = Setting(spread, min_particles=100)
    sizes = [[made.run(seed, k)[0] for seed in range(30)] for k in (resample_systematic, resample)]
    # A sorted sweep would stop early: it has seen one corner's bins only. Even draws meet the rare
    # bins somewhat sooner than independent ones, so they err on the other side.
    assert 0.97 < np.mean(sizes[0]) / np.mean(sizes[1]) < 1.2
    count, k = made.run(1)
    keys = [bin_key(*made.target[:3, i], made.bins) for i in range(count)]
    assert k == len(set(keys))
    assert (made.bins.key[made.scratch.bin_of[:count]] == keys).all()


def test_injection_replaces_its_share():
    made = Setting(0.2, min_particles=COUNT)
    count, _ = made.run(2, chance=0.3)
    fresh = ~np.isin(made.target[0, :count], made.source[0])
    assert fresh.mean() == pytest.approx(0.3, abs=0.03)
