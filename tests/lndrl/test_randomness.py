"""Streams of random numbers against a twin in plain Python integers and against their moments."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from scipy import stats

from lndrl.randomness import (
    Stream,
    episode_states,
    fill_normals,
    fill_normals32,
    next_uint64,
    normal,
    stream_state,
    uniform,
)

MASK = (1 << 64) - 1
SAMPLES = 4_000_000
FEWER = 400_000  # for tests that sort
TAIL = 3.6541528853610088  # where the ziggurat changes its method


def rotate(value: int, bits: int) -> int:
    return ((value << bits) | (value >> (64 - bits))) & MASK


def twin_next(state: list[int]) -> int:
    """xoshiro256++ as published, in integers without a size."""
    result = (rotate((state[0] + state[3]) & MASK, 23) + state[0]) & MASK
    shifted = (state[1] << 17) & MASK
    state[2] ^= state[0]
    state[3] ^= state[1]
    state[1] ^= state[2]
    state[0] ^= state[3]
    state[2] ^= shifted
    state[3] = rotate(state[3], 45)
    return result


@njit
def fill_uniform(state, out):
    for i in range(out.size):
        out[i] = uniform(state)


@njit
def fill_normal(state, out):
    for i in range(out.size):
        out[i] = normal(state)


@njit
def collect_tail(state, draws):
    kept = np.empty(draws // 1000)
    count = 0
    for _ in range(draws):
        drawn = normal(state)
        if abs(drawn) > TAIL:
            kept[count] = drawn
            count += 1
    return kept[:count]


@pytest.fixture(scope="module")
def uniforms() -> np.ndarray:
    out = np.empty(SAMPLES)
    fill_uniform(stream_state(11, 0, 0, Stream.LASER), out)
    return out


@pytest.fixture(scope="module")
def normals() -> np.ndarray:
    out = np.empty(SAMPLES)
    fill_normal(stream_state(12, 0, 0, Stream.LASER), out)
    return out


WORDS = st.lists(st.integers(0, MASK), min_size=4, max_size=4).filter(any)


@given(WORDS)
def test_bits_equal_the_published_generator(words: list[int]) -> None:
    state = np.array(words, dtype=np.uint64)
    twin = list(words)
    for _ in range(20):
        assert int(next_uint64(state)) == twin_next(twin)
        assert [int(word) for word in state] == twin


def test_published_first_outputs() -> None:
    """The reference program's outputs for state 1, 2, 3, 4 (first: rotl(5, 23) + 1)."""
    state = np.array([1, 2, 3, 4], dtype=np.uint64)
    assert [int(next_uint64(state)) for _ in range(3)] == [41943041, 58720359, 3588806011781223]


@given(WORDS)
def test_uniform_is_the_top_53_bits(words: list[int]) -> None:
    state = np.array(words, dtype=np.uint64)
    expected = (twin_next(list(words)) >> 11) * 2.0**-53
    drawn = uniform(state)
    assert drawn == expected
    assert 0.0 <= drawn < 1.0


def test_uniform_is_uniform(uniforms: np.ndarray) -> None:
    assert stats.kstest(uniforms[:FEWER], "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(uniforms[:-1], uniforms[1:])[0, 1]) < 5 / math.sqrt(SAMPLES)


def test_normal_moments(normals: np.ndarray) -> None:
    error = 1 / math.sqrt(SAMPLES)
    assert abs(normals.mean()) < 5 * error
    assert abs((normals**2).mean() - 1) < 5 * math.sqrt(2) * error
    assert abs((normals**3).mean()) < 5 * math.sqrt(15) * error
    assert abs((normals**4).mean() - 3) < 5 * math.sqrt(96) * error


def test_normal_distribution(normals: np.ndarray) -> None:
    assert stats.kstest(normals[:FEWER], "norm").pvalue > 1e-3
    assert abs(np.corrcoef(normals[:-1], normals[1:])[0, 1]) < 5 / math.sqrt(SAMPLES)


def test_normal_body_has_the_right_shape(normals: np.ndarray) -> None:
    """Equally likely bins, fine enough to see the layers of the ziggurat."""
    bins = 2000
    counts = np.bincount((stats.norm.cdf(normals) * bins).astype(int), minlength=bins)
    assert stats.chisquare(counts).pvalue > 1e-4


@pytest.fixture(scope="module")
def tail() -> np.ndarray:
    """Those of 60 million normal draws that lie beyond the last layer."""
    return collect_tail(stream_state(13, 0), 60_000_000)


@pytest.mark.parametrize("edge", [TAIL, 4.0, 4.5, 5.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_normal_tails_have_their_share(tail: np.ndarray, side: float, edge: float) -> None:
    expected = stats.norm.sf(edge) * 60_000_000
    assert abs(np.sum(side * tail > edge) - expected) < 5 * math.sqrt(expected) + 1


def test_normal_tail_has_the_right_shape(tail: np.ndarray) -> None:
    share = stats.norm.sf(np.abs(tail)) / stats.norm.sf(TAIL)
    assert stats.kstest(share, "uniform").pvalue > 1e-4


def test_one_stream_repeats_itself() -> None:
    first, second = np.empty(1000), np.empty(1000)
    fill_normal(stream_state(3, 5, 7, Stream.ODOMETRY), first)
    fill_normal(stream_state(3, 5, 7, Stream.ODOMETRY), second)
    assert first.tobytes() == second.tobytes()


def test_streams_differ_in_seed_world_episode_and_purpose() -> None:
    paths = [
        (seed, world, episode, purpose)
        for seed in (0, 1, 2)
        for world in (0, 1, 300)
        for episode in (0, 1, 70_000)
        for purpose in Stream
    ]
    states = {tuple(map(int, stream_state(*path))) for path in paths}
    assert len(states) == len(paths)


def test_a_later_stream_leaves_the_first_six_as_they_were() -> None:
    """Every world that was ever stored draws from them."""
    sequence = np.random.SeedSequence(7, spawn_key=(3, 2))
    before = sequence.generate_state(4 * 6, np.uint64).reshape(6, 4)
    states = episode_states(7, 3, 2)
    assert len(states) == len(Stream) > 6
    np.testing.assert_array_equal(states[:6], before)
    assert [stream.value for stream in Stream][:6] == [0, 1, 2, 3, 4, 5]


def test_neighbouring_streams_are_uncorrelated() -> None:
    draws = np.empty((24, 20_000))
    for world in range(24):
        fill_normal(stream_state(1, world, 0, Stream.LASER), draws[world])
    correlation = np.corrcoef(draws) - np.eye(24)
    assert np.abs(correlation).max() < 6 / math.sqrt(draws.shape[1])


def test_a_seed_below_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="non-negative"):
        stream_state(-1, 0)


def test_filled_normals_are_the_draws_of_normal() -> None:
    one_by_one, filled = stream_state(3, 1), stream_state(3, 1)
    expected = np.array([normal(one_by_one) for _ in range(20_000)])
    out = np.empty(20_000)
    fill_normals(filled, out)
    np.testing.assert_array_equal(out, expected)
    np.testing.assert_array_equal(filled, one_by_one)


def twin_normals32(state: list[int], count: int) -> np.ndarray:
    """Box and Muller's pairs from splitmix64 words, in float64."""
    key = twin_next(state)
    first, second = [], []
    for i in range(count // 2):
        word = (key + i * 0x9E3779B97F4A7C15) & MASK
        word = ((word ^ (word >> 30)) * 0xBF58476D1CE4E5B9) & MASK
        word = ((word ^ (word >> 27)) * 0x94D049BB133111EB) & MASK
        word ^= word >> 31
        radius = math.sqrt(-2.0 * math.log(((word >> 33) + 0.5) * 2.0**-31))
        around = (word << 2) & 0xFFFFFFFF
        around -= (around >> 31) << 32
        angle = ((word >> 30) & 3) * math.pi / 2 + around * math.pi / 4 / 2.0**31
        first.append(radius * math.cos(angle))
        second.append(radius * math.sin(angle))
    return np.array(first + second)


@given(WORDS)
def test_filled_normals32_are_box_and_mullers(words: list[int]) -> None:
    state, out = np.array(words, dtype=np.uint64), np.empty(40, np.float32)
    fill_normals32(state, out)
    assert out == pytest.approx(twin_normals32(list(words), 40), abs=2e-5, rel=1e-5)


@pytest.mark.parametrize("size", [2, 719, 720])
def test_filled_normals32_are_standard_normal(size: int) -> None:
    state, rows = stream_state(14, size), np.empty((FEWER // size, size), np.float32)
    for row in rows:
        fill_normals32(state, row)
    drawn = rows.astype(np.float64).ravel()
    error = 1 / math.sqrt(drawn.size)
    assert abs(drawn.mean()) < 5 * error
    assert abs((drawn**2).mean() - 1) < 5 * math.sqrt(2) * error
    assert abs((drawn**4).mean() - 3) < 5 * math.sqrt(96) * error
    assert stats.kstest(drawn, "norm").pvalue > 1e-3
    half = size // 2  # a pair shares its radius, neighbours share nothing
    pairs = rows[:, :half] * rows[:, half : 2 * half]
    assert abs(pairs.mean()) < 5 * error * math.sqrt(2)
    assert abs(np.corrcoef(drawn[:-1], drawn[1:])[0, 1]) < 5 * error
