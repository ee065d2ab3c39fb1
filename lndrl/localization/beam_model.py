"""Beam range finder model as in ROS AMCL (Thrun et al. §6.3): a ray is cast per particle and beam.

``pz = z_hit exp(-(z - z*)^2 / (2 sigma_hit^2)) + [z < z*] z_short lambda exp(-lambda z)
+ [z = max] z_max + [z < max] z_rand / max``, and a particle's weight is ``1 + sum pz^3``: like ROS
and unlike the book, not a product. Some hundred times the work of a likelihood field.
"""

from __future__ import annotations

import math

import numpy as np

from lndrl.kernels import kernel
from lndrl.maps.raycast import cast_ray

_NEGLIGIBLE = 40.0  # exp(-40) vanishes beside every other summand


@kernel(_nrt=False, error_model="numpy")
def prepare_readings(ranges, bearings, range_max, beam_numbers, readings, range_min=-1.0):
    """Per usable beam: cos, sin, range (m), the summand of short readings, the constant summand.

    Readings at or beyond ``range_max``, or at or below ``range_min``, stay as missed echoes;
    negative and non-finite ones are left out. ``readings`` is (5, n); returns the number of beams
    kept.
    """
    _, z_short, z_max, z_rand, _, decay = beam_numbers
    kept = 0
    for i in range(min(ranges.size, bearings.size, readings.shape[1])):
        reading = np.float64(ranges[i])
        bearing = np.float64(bearings[i])
        if not (np.isfinite(reading) and np.isfinite(bearing)) or reading < 0.0:
            continue
        missed = reading >= range_max or reading <= range_min
        reading = range_max if missed else reading
        readings[0, kept] = math.cos(bearing)
        readings[1, kept] = math.sin(bearing)
        readings[2, kept] = reading
        readings[3, kept] = z_short * decay * math.exp(-decay * reading)
        readings[4, kept] = z_max if missed else z_rand / range_max
        kept += 1
    return kept


@kernel(_nrt=False, error_model="numpy")
def beam_model(
    particles, count, readings, kept, field, range_max, beam_numbers, likelihood,
    mount_x=0.0, mount_y=0.0,
):  # fmt: skip
    """``1 + sum pz^3`` of ``count`` particles (rows x, y, yaw, cos, sin) into ``likelihood``.

    ``readings`` and ``kept`` come from ``prepare_readings``; ``field`` offers the grid's
    ``clearance``, ``resolution`` (m) and origin. Rays start at the scanner, which stands at
    ``mount_x``, ``mount_y`` (m, robot frame).
    """
    z_hit, sigma = beam_numbers[0], beam_numbers[4]
    sharpness = 0.5 / (sigma * sigma)
    inverse = 1.0 / field.resolution
    for i in range(count):
        cosine, sine = particles[3, i], particles[4, i]
        x = particles[0, i] + (cosine * mount_x - sine * mount_y)
        y = particles[1, i] + (sine * mount_x + cosine * mount_y)
        total = 1.0
        for b in range(kept):
            dx = cosine * readings[0, b] - sine * readings[1, b]
            dy = sine * readings[0, b] + cosine * readings[1, b]
            expected = cast_ray(
                field.clearance, inverse, field.origin_x, field.origin_y, x, y, dx, dy, range_max
            )
            miss = readings[2, b] - expected
            p = readings[4, b]
            exponent = miss * miss * sharpness
            if exponent < _NEGLIGIBLE:
                p += z_hit * math.exp(-exponent)
            if miss < 0.0:
                p += readings[3, b]
            total += p * p * p
        likelihood[i] = np.float32(total)
