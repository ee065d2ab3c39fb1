"""Recovery that lasts until the scan fits again (Thrun et al. table 8.3).

ROS clears both averages with the first random particle, so a burst lasts one resampling and a
kidnapped filter mostly stays where it is. Thrun's text does not clear them. Kept on, it must not
answer to every pedestrian in the way: ``tolerance`` is how many times worse than usual the recent
scans must fit before anything happens.
"""

from __future__ import annotations

from lndrl.kernels import kernel
from lndrl.localization.resampling import recovery_chance


@kernel(_nrt=False, error_model="numpy")
def injection_chance(averages, tolerance, persistent):
    """Chance that a drawn particle is random: ``max(0, 1 - tolerance * w_fast / w_slow)``.

    ``averages`` is [w_slow, w_fast]. Unless ``persistent``, ROS's rule, which knows no tolerance
    and clears the averages in place.
    """
    if persistent == 0:
        return recovery_chance(averages)
    if averages[0] <= 0.0:
        return 0.0
    return max(0.0, 1.0 - tolerance * averages[1] / averages[0])
