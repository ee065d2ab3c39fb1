"""KLD bound, draws and recovery against published figures, NumPy twins and frequencies."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.localization.belief import make_field, make_scratch
from lndrl.localization.bins import bin_key, bin_keys, empty, insert, make_bins
from lndrl.localization.likelihood import LikelihoodMap
from lndrl.localization.resampling import (
    NAMELESS,
    accumulate,
    draw,
    follow_average,
    kld_limits,
    name_keys,
    recovery_chance,
    resample,
)
from lndrl.maps.grid import OccupancyGrid
from lndrl.randomness import stream_state, uniform


def setting(count=4000, spread=0.2, seed=0, **changes):
    """A weighted cloud and all that ``resample`` needs."""
    config = LocalizationConfig(**{"max_particles": count, **changes})
    rng = np.random.default_rng(seed)
    yaw = rng.normal(1.0, spread, count)
    x, y = rng.normal([[5.0], [4.0]], spread, (2, count))
    occupied = np.zeros((80, 100), dtype=bool)
    occupied[:, 50:] = True
    field = LikelihoodMap.build(OccupancyGrid(occupied, 0.1, (1.0, 2.0)), config)
    made = SimpleNamespace(
        source=np.array([x, y, yaw, np.cos(yaw), np.sin(yaw)]),
        target=np.zeros((5, count)),
        weights=rng.uniform(0.1, 1.0, count),
        scratch=make_scratch(config, LaserConfig(beams=10)),
        bins=make_bins(config),
        limits=kld_limits(config),
        field=make_field(field),
        state=stream_state(seed),
        config=config,
    )
    bin_keys(made.source, count, made.bins, made.scratch.keys)
    return made


def run_resample(made, count, chance=0.0):
    empty(made.bins)
    return resample(
        made.source, made.weights, count, made.target, made.scratch,
        made.bins, made.limits, chance, made.field, made.state,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("err", "z", "expected"),
    [
        (0.05, 0.99, [37, 66, 131, 250, 588, 1129]),
        (0.05, 2.326, [93, 134, 217, 363, 750, 1347]),
        (0.05, 3.0, [135, 181, 273, 430, 842, 1467]),
        (0.01, 0.99, [182, 327, 651, 1249, 2936, 5644]),
        (0.01, 3.0, [674, 901, 1363, 2150, 4208, 7332]),
    ],
)
def test_kld_limits_match_the_published_table(err, z, expected):
    least: dict[str, Any] = {"min_particles": 1, "max_particles": 9000, "kld_one_bin": "min"}
    config = LocalizationConfig(kld_err=err, kld_z=z, **least)
    limits = kld_limits(config)
    if z == 2.326:
        probability = LocalizationConfig(
            kld_err=err, kld_z=0.99, kld_z_is_probability=True, **least
        )
        assert np.abs(kld_limits(probability) - limits).max() <= 1
    one = 10.0 * (0.05 / err) * (1 - 2 / 9 + math.sqrt(2 / 9) * z) ** 3
    assert limits[0] == limits[1] == 1 and limits[2] == math.ceil(one)
    assert [limits[k] for k in (3, 5, 10, 20, 50, 100)] == pytest.approx(expected, abs=1)


def test_kld_limits_of_the_paper():
    assert (kld_limits(LocalizationConfig())[:2] == 2000).all()  # ROS: one bin asks for all
    limits = kld_limits(LocalizationConfig(kld_one_bin="min"))
    assert (limits[:43] == 500).all() and limits[0] == limits[1] == 500
    assert (kld_limits(LocalizationConfig())[2:] == limits[2:]).all()
    assert limits[150] == 1661
    assert limits[180] < 2000 and (limits[184:] == 2000).all()
    assert (np.diff(limits) >= 0).all()


def test_draw_is_the_inverse_of_the_cumulative_weights():
    rng = np.random.default_rng(5)
    for count in (1, 2, 3, 100):
        values = rng.exponential(1.0, count) ** 3
        cumulative, guide = np.zeros(count), np.zeros(count, dtype=np.int32)
        total = accumulate(values, count, cumulative, guide)
        assert np.allclose(cumulative, np.cumsum(values))
        ours, twin = stream_state(count), stream_state(count)
        for _ in range(2000):
            expected = np.searchsorted(cumulative, uniform(twin) * total, side="right")
            assert draw(cumulative, guide, count, total, ours) == min(expected, count - 1)


def test_frequencies_are_multinomial():
    values = np.array([1.0, 0.0, 5.0, 2.0, 0.5, 1.5])
    cumulative, guide = np.zeros(6), np.zeros(6, dtype=np.int32)
    total = accumulate(values, 6, cumulative, guide)
    state = stream_state(9)
    draws = 60_000
    counts = np.bincount([draw(cumulative, guide, 6, total, state) for _ in range(draws)])
    expected = draws * values / total
    used = values > 0
    chi_square = ((counts[used] - expected[used]) ** 2 / expected[used]).sum()
    assert counts[1] == 0
    assert chi_square < 20.5  # 0.999 quantile, 4 degrees of freedom


def test_resample_stops_one_past_the_bound_and_counts_bins():
    for spread in (0.02, 0.2, 0.6, 1.5):
        made = setting(spread=spread, min_particles=100)
        count, k = run_resample(made, 4000)
        new = made.target[:, :count]
        keys = [bin_key(*new[:3, i], made.bins) for i in range(count)]
        assert k == len(set(keys))
        seen: set[int] = set()
        needed = 0
        for n, key in enumerate(keys, start=1):
            seen.add(key)
            if n > made.limits[len(seen)]:
                needed = n
                break
        assert count == (needed or 4000)
        named = made.bins.key[made.scratch.bin_of[:count]]
        assert (named == keys).all()
        assert np.isin(new[0], made.source[0]).all()


def resample_twin(made, count):
    """Draw by draw in NumPy: rows, their bins, the bins' keys, and the state that is left."""
    state = made.state.copy()
    cumulative = np.zeros(count)
    total = 0.0
    for i in range(count):
        total += made.weights[i]
        cumulative[i] = total
    most = len(made.limits) - 1
    chosen: list[int] = []
    bin_of: list[int] = []
    bins: dict[int, int] = {}
    while len(chosen) < most and not (chosen and len(chosen) > made.limits[len(bins)]):
        i = min(np.searchsorted(cumulative, uniform(state) * total, side="right"), count - 1)
        bin_of.append(bins.setdefault(int(made.scratch.keys[i]), len(bins)))
        chosen.append(i)
    # Whole blocks are drawn, the last one as far as there would be room.
    for _ in range(min(-len(chosen) % 512, most - len(chosen))):
        uniform(state)
    return made.source[:, chosen], bin_of, list(bins), state


@pytest.mark.parametrize("weigh", ["even", "steep", "one", "zeros", "tiny"])
@pytest.mark.parametrize(("spread", "bins"), [(1e-3, 1), (0.1, 3), (0.3, 15), (1.5, 400)])
def test_a_set_is_what_single_draws_make(spread: float, bins: int, weigh: str) -> None:
    for seed, count in enumerate((1, 2, 501, 777, 2000)):
        made = setting(spread=spread, seed=seed, count=2000, kld_one_bin="min")
        rng = np.random.default_rng(seed)
        made.weights[:] = {
            "even": np.full(2000, 1.0 / count),
            "steep": rng.exponential(1.0, 2000) ** 8,
            "one": np.where(np.arange(2000) == count // 2, 1.0, 1e-9),
            "zeros": np.where(np.arange(2000) % 3 == 0, rng.random(2000), 0.0),
            "tiny": rng.random(2000) * 1e-300,
        }[weigh]
        rows, bin_of, keys, state = resample_twin(made, count)
        drawn, k = run_resample(made, count)
        assert (drawn, k) == (rows.shape[1], len(keys))
        assert (made.target[:, :drawn] == rows).all()
        assert (made.scratch.bin_of[:drawn] == bin_of).all()
        assert (made.bins.key[:k] == keys).all()
        assert (made.state == state).all()
        assert k == 1 or weigh in ("one", "steep") or count < 501 or k >= bins / 3


def test_what_is_no_number_is_drawn_from_within_the_set() -> None:
    for value in (np.nan, np.inf, 0.0, -1.0):
        cumulative, guide = np.zeros(64), np.zeros(64, dtype=np.int32)
        total = accumulate(np.full(64, value), 64, cumulative, guide)
        assert 0 <= guide.min() <= guide.max() < 64
        assert all(0 <= draw(cumulative, guide, 64, total, stream_state(n)) < 64 for n in range(99))


@pytest.mark.parametrize("different", [1, 2, NAMELESS - 1, NAMELESS, NAMELESS + 1, 40])
def test_the_first_keys_have_names_and_no_others(different: int) -> None:
    rng = np.random.default_rng(different)
    keys = rng.permutation(np.arange(300) % different) * (1 << 40) - 7
    names = np.full(301, 99, np.int32)
    assert name_keys(keys, 300, names) == min(different, NAMELESS)
    known: dict[int, int] = {}
    expected = [min(known.setdefault(int(key), len(known)), NAMELESS) for key in keys]
    assert names[:300].tolist() == expected and names[300] == 99


@pytest.mark.parametrize(("asked", "drawn"), [("max", 4000), ("min", 501)])
def test_one_bin_asks_for_what_it_is_told_to(asked, drawn):
    made = setting(spread=1e-4, kld_one_bin=asked)
    made.source[:2] = 5.1
    bin_keys(made.source, 4000, made.bins, made.scratch.keys)
    assert run_resample(made, 4000) == (drawn, 1)


def test_the_second_bin_ends_what_the_first_asked_for():
    made = setting(spread=1e-4, kld_one_bin="max")
    made.source[:2] = 5.1
    made.source[0, :4] = 6.1  # a thousandth of the mass lies in another bin
    bin_keys(made.source, 4000, made.bins, made.scratch.keys)
    count, k = run_resample(made, 4000)
    first_other = int(np.argmax(made.target[0, :count] > 5.6)) if k == 2 else count
    assert count == (max(501, first_other + 1) if k == 2 else 4000)


def test_injection_is_uniform_over_free_cells_and_headings():
    made = setting(count=20_000, min_particles=20_000)
    count, _ = run_resample(made, 20_000, chance=0.3)
    new = made.target[:, :count]
    random = ~np.isin(new[0], made.source[0])
    assert random.mean() == pytest.approx(0.3, abs=0.015)
    x, y, yaw = new[:3, random]
    # Free is x in [1, 6), y in [2, 10); centres of 0.1 m cells.
    assert x.min() == pytest.approx(1.05) and x.max() == pytest.approx(5.95)
    assert y.min() == pytest.approx(2.05) and y.max() == pytest.approx(9.95)
    assert np.histogram(x, 5, (1, 6))[0] == pytest.approx(random.sum() / 5, rel=0.15)
    assert np.histogram(yaw, 4, (-math.pi, math.pi))[0] == pytest.approx(random.sum() / 4, rel=0.12)
    assert np.allclose(new[3:], [np.cos(new[2]), np.sin(new[2])])


def test_recovery_follows_the_averages():
    averages = np.zeros(2)
    follow_average(averages, 30.0, 0.001, 0.1)
    assert averages.tolist() == [30.0, 30.0]
    assert recovery_chance(averages) == 0.0
    follow_average(averages, 10.0, 0.001, 0.1)
    slow, fast = 30.0 - 0.001 * 20.0, 30.0 - 0.1 * 20.0
    assert averages == pytest.approx([slow, fast])
    assert recovery_chance(averages) == pytest.approx(1.0 - fast / slow)
    assert averages.tolist() == [0.0, 0.0]
    assert recovery_chance(averages) == 0.0
    follow_average(averages, 10.0, 0.001, 0.1)
    follow_average(averages, 20.0, 0.001, 0.1)
    assert recovery_chance(averages) == 0.0  # a better fit never injects
    assert averages[1] == pytest.approx(11.0)


def test_hash_table_counts_like_a_set():
    rng = np.random.default_rng(8)
    bins = make_bins(LocalizationConfig(min_particles=1, max_particles=3000))
    keys = rng.integers(-(2**40), 2**40, 3000)[rng.integers(0, 1500, 3000)]
    k = 0
    numbers: dict[int, int] = {}
    for key in keys:
        b, k = insert(key, bins, k)
        assert numbers.setdefault(key, b) == b
    assert k == len(set(keys.tolist()))
