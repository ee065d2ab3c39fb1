"""Random numbers for compiled kernels: one xoshiro256++ state per stream, bit-equal everywhere.

Every draw of a world comes from a stream derived from (run seed, world id, episode, purpose), so
one seed replays one world bit for bit, whatever else runs. Kernels take the state as a
``uint64[4]`` array and advance it in place.

Sources: Blackman & Vigna, "Scrambled linear pseudorandom number generators" (xoshiro256++);
Marsaglia & Tsang, "The ziggurat method for generating random variables" (256 layers); Steele, Lea
& Flood, "Fast splittable pseudorandom number generators" (splitmix64); Box & Muller, "A note on
the generation of random normal deviates".
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.kernels import kernel

State = NDArray[np.uint64]


class Stream(IntEnum):
    """What a stream of draws is for; streams never share numbers."""

    LAYOUT = 0  # starts, goals, routes, models: once per episode
    PEDESTRIANS = 1
    LASER = 2
    ODOMETRY = 3
    LOCALIZATION = 4
    POLICY = 5
    SETTINGS = 6  # what ``randomize`` draws of an episode
    REPLICAS = 7  # of the robot's filter


def stream_state(seed: int, *path: int) -> State:
    """State of the stream at ``path`` below ``seed``, e.g. ``(world_id, episode, Stream.LASER)``.

    Returns ``uint64[4]``, never all zero (SeedSequence mixes every word).
    """
    sequence = np.random.SeedSequence(seed, spawn_key=tuple(int(p) for p in path))
    return np.asarray(sequence.generate_state(4, np.uint64), dtype=np.uint64)


def episode_states(seed: int, world_id: int, episode: int) -> State:
    """States of all streams of an episode, ``uint64[len(Stream), 4]``, row by ``Stream``.

    The same for the same three numbers, whatever else runs; one mixing for all streams, because
    episodes start often. A stream that is added at the end leaves the others as they were.
    """
    sequence = np.random.SeedSequence(seed, spawn_key=(int(world_id), int(episode)))
    words = sequence.generate_state(4 * len(Stream), np.uint64)
    return np.asarray(words, dtype=np.uint64).reshape(len(Stream), 4)


_LAYERS = 256
_TAIL = 3.6541528853610088  # start of the tail for 256 layers
_LAYER_AREA = 0.00492867323399


def _ziggurat_tables() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Layer edges x[0..256] (x[0] is the base strip's pseudo-edge) and densities f(x)."""
    x = np.zeros(_LAYERS + 1)
    density_tail = np.exp(-0.5 * _TAIL * _TAIL)
    x[0] = _LAYER_AREA / density_tail
    x[1] = _TAIL
    for i in range(2, _LAYERS):
        x[i] = np.sqrt(-2.0 * np.log(_LAYER_AREA / x[i - 1] + np.exp(-0.5 * x[i - 1] ** 2)))
    x[_LAYERS] = 0.0
    return x, np.exp(-0.5 * x * x)


_EDGES, _DENSITIES = _ziggurat_tables()


@njit(inline="always")
def _rotate_left(value, bits):
    return (value << np.uint64(bits)) | (value >> np.uint64(64 - bits))


@kernel(_nrt=False)
def next_uint64(state):
    """Next 64 random bits; ``state`` is ``uint64[4]`` and advances in place."""
    result = _rotate_left(state[0] + state[3], 23) + state[0]
    shifted = state[1] << np.uint64(17)
    state[2] ^= state[0]
    state[3] ^= state[1]
    state[1] ^= state[2]
    state[0] ^= state[3]
    state[2] ^= shifted
    state[3] = _rotate_left(state[3], 45)
    return result


@kernel(_nrt=False)
def uniform(state):
    """Uniform float64 in [0, 1) with 53 bits."""
    return np.float64(next_uint64(state) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel(_nrt=False)
def _edge_of_layer(state, layer, signed):
    """The ziggurat's rare part, outside a layer's rectangle: (accepted, value)."""
    if layer == 0:
        while True:
            tail = -np.log(1.0 - uniform(state)) / _TAIL
            if -2.0 * np.log(1.0 - uniform(state)) >= tail * tail:
                return True, (_TAIL + tail if signed > 0.0 else -(_TAIL + tail))
    x = signed * _EDGES[layer]
    height = _DENSITIES[layer] + uniform(state) * (_DENSITIES[layer + 1] - _DENSITIES[layer])
    return height < np.exp(-0.5 * x * x), x


@njit(inline="always")
def _layer_and_sign(bits):
    """Low 8 bits choose the layer, the top 53 are a signed uniform in [-1, 1)."""
    # Through int64: processors without AVX-512 convert unsigned words slowly.
    signed = np.float64(np.int64(bits >> np.uint64(11))) * (2.0 / 9007199254740992.0) - 1.0
    return np.int64(bits & np.uint64(0xFF)), signed


@kernel(_nrt=False)
def normal(state):
    """Standard normal float64 by the ziggurat method."""
    while True:
        layer, signed = _layer_and_sign(next_uint64(state))
        x = signed * _EDGES[layer]
        if abs(x) < _EDGES[layer + 1]:
            return x
        accepted, x = _edge_of_layer(state, layer, signed)
        if accepted:
            return x


@kernel(_nrt=False)
def fill_normals(state, out):
    """Fill ``out`` (n,) with standard normals: the draws of ``normal`` one after the other.

    Three times as fast, because the generator's words stay in registers between draws.
    """
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    i = 0
    while i < out.shape[0]:
        bits = _rotate_left(s0 + s3, 23) + s0
        shifted = s1 << np.uint64(17)
        s2 ^= s0
        s3 ^= s1
        s1 ^= s2
        s0 ^= s3
        s2 ^= shifted
        s3 = _rotate_left(s3, 45)
        layer, signed = _layer_and_sign(bits)
        x = signed * _EDGES[layer]
        accepted = abs(x) < _EDGES[layer + 1]
        if not accepted:
            state[0], state[1], state[2], state[3] = s0, s1, s2, s3
            accepted, x = _edge_of_layer(state, layer, signed)
            s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
        if accepted:
            out[i] = x
            i += 1
    state[0], state[1], state[2], state[3] = s0, s1, s2, s3


@njit(inline="always")
def next_uniform(s0, s1, s2, s3):
    """The draw of ``uniform`` and the state after it, for loops that hold it in registers."""
    bits = _rotate_left(s0 + s3, 23) + s0
    shifted = s1 << np.uint64(17)
    s2 ^= s0
    s3 ^= s1
    s1 ^= s2
    s0 ^= s3
    s2 ^= shifted
    s3 = _rotate_left(s3, 45)
    # Through int64: processors without AVX-512 convert unsigned words slowly.
    draw = np.float64(np.int64(bits >> np.uint64(11))) * (1.0 / 9007199254740992.0)
    return draw, s0, s1, s2, s3


@kernel(_nrt=False)
def fill_uniforms(state, out):
    """Fill ``out`` (n,) with uniforms in [0, 1): the draws of ``uniform`` one after the other."""
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    for i in range(out.shape[0]):
        out[i], s0, s1, s2, s3 = next_uniform(s0, s1, s2, s3)
    state[0], state[1], state[2], state[3] = s0, s1, s2, s3


@njit(inline="always")
def _mixed(word):
    """The splitmix64 finaliser: neighbouring words become unrelated ones."""
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@njit(inline="always")
def _radius(bits):
    """sqrt(-2 log u), u uniform in (0, 1], from an int32 in [0, 2^31); float32 without calls."""
    u = np.float32(bits) + np.float32(0.5)
    # Mantissa in [sqrt(1/2), sqrt(2)); sums of int32 are int64 unless they are said not to be.
    pattern = np.int32(np.float32(u).view(np.int32) - np.int32(0x3F3504F3))
    exponent = np.float32(np.int32(pattern >> np.int32(23)) - np.int32(31))
    mantissa = np.int32(np.int32(pattern & np.int32(0x7FFFFF)) + np.int32(0x3F3504F3))
    x = np.int32(mantissa).view(np.float32) - np.float32(1.0)
    p = np.float32(-0.07631209449)
    p = p * x + np.float32(0.1285492663)
    p = p * x + np.float32(-0.1320788938)
    p = p * x + np.float32(0.1419000592)
    p = p * x + np.float32(-0.1661652261)
    p = p * x + np.float32(0.20001616)
    p = p * x + np.float32(-0.2500105952)
    p = p * x + np.float32(0.3333332827)
    square = x * x
    p = x - square * np.float32(0.5) + square * x * p
    logarithm = p + exponent * np.float32(0.6931471806)
    square = np.float32(-2.0) * logarithm
    return np.sqrt(square if square > np.float32(0.0) else np.float32(0.0))


@kernel(error_model="numpy")
def fill_normals32(state, out):
    """Fill ``out`` (float32, (n,)) with standard normals.

    Three times as fast as ``fill_normals``: one word of ``state`` is the key of a counter, so the
    draws do not wait for each other, and Box and Muller's pair costs arithmetic only. 31 bits of
    radius: no draw is beyond 6.7 deviations.
    """
    key = next_uint64(state)
    n = np.uint64(out.shape[0])
    pairs = n // np.uint64(2)
    for i in range(pairs):
        word = _mixed(key + i * np.uint64(0x9E3779B97F4A7C15))
        radius = _radius(np.int32(word >> np.uint64(33)))
        # Two bits choose the quarter of the circle, thirty the angle around its middle.
        quarter = np.int32((word >> np.uint64(30)) & np.uint64(3))
        around = np.float32(np.int32(word << np.uint64(2))) * np.float32(np.pi / 4 / 2147483648.0)
        z = around * around
        sine = np.float32(-0.0001946211663)
        sine = sine * z + np.float32(0.008331584603)
        sine = sine * z + np.float32(-0.1666663675)
        sine = (sine * z + np.float32(0.9999999862)) * around
        cosine = np.float32(2.437992954e-05)
        cosine = cosine * z + np.float32(-0.001388661921)
        cosine = cosine * z + np.float32(0.04166661674)
        cosine = cosine * z + np.float32(-0.4999999962)
        cosine = cosine * z + np.float32(1.0)
        swapped = (quarter & np.int32(1)) != np.int32(0)
        a = sine if swapped else cosine
        b = cosine if swapped else sine
        a = -a if (quarter == np.int32(1)) | (quarter == np.int32(2)) else a
        b = -b if quarter >= np.int32(2) else b
        out[i] = radius * a
        out[pairs + i] = radius * b
    if n % np.uint64(2):
        out[n - np.uint64(1)] = normal(state)
