"""Random numbers for compiled kernels: one xoshiro256++ state per stream, bit-equal everywhere.

Every draw of a world comes from a stream derived from (run seed, world id, episode, purpose), so
one seed replays one world bit for bit, whatever else runs. Kernels take the state as a
``uint64[4]`` array and advance it in place.

Sources: Blackman & Vigna, "Scrambled linear pseudorandom number generators" (xoshiro256++);
Marsaglia & Tsang, "The ziggurat method for generating random variables" (256 layers).
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

State = NDArray[np.uint64]


class Stream(IntEnum):
    """What a stream of draws is for; streams never share numbers."""

    LAYOUT = 0  # starts, goals, routes, models: once per episode
    PEDESTRIANS = 1
    LASER = 2
    ODOMETRY = 3
    LOCALIZATION = 4
    POLICY = 5


def stream_state(seed: int, *path: int) -> State:
    """State of the stream at ``path`` below ``seed``, e.g. ``(world_id, episode, Stream.LASER)``.

    Returns ``uint64[4]``, never all zero (SeedSequence mixes every word).
    """
    sequence = np.random.SeedSequence(seed, spawn_key=tuple(int(p) for p in path))
    return np.asarray(sequence.generate_state(4, np.uint64), dtype=np.uint64)


def episode_states(seed: int, world_id: int, episode: int) -> State:
    """States of all streams of an episode, ``uint64[len(Stream), 4]``, row by ``Stream``.

    The same for the same three numbers, whatever else runs; one mixing for all streams, because
    episodes start often.
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def uniform(state):
    """Uniform float64 in [0, 1) with 53 bits."""
    return np.float64(next_uint64(state) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def fill_uniforms(state, out):
    """Fill ``out`` (n,) with uniforms in [0, 1): the draws of ``uniform`` one after the other."""
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    for i in range(out.shape[0]):
        bits = _rotate_left(s0 + s3, 23) + s0
        shifted = s1 << np.uint64(17)
        s2 ^= s0
        s3 ^= s1
        s1 ^= s2
        s0 ^= s3
        s2 ^= shifted
        s3 = _rotate_left(s3, 45)
        out[i] = np.float64(np.int64(bits >> np.uint64(11))) * (1.0 / 9007199254740992.0)
    state[0], state[1], state[2], state[3] = s0, s1, s2, s3
