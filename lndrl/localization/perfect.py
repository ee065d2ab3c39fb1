"""Localization that knows the truth (``localization.kind: perfect``)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lndrl.localization.angles import wrap
from lndrl.randomness import State


class PerfectLocalization:
    """Same interface as ``AMCL``; the estimate is the pose last told, without any doubt.

    Attributes (updated in place): ``pose_estimated`` (3,), ``variance`` (3,) and ``covariance``
    (3, 3), the latter two always zero.
    """

    def __init__(self, pose: NDArray[np.float64] | None = None) -> None:
        """``pose`` (3,) is the memory to keep the estimate in; by default an own one."""
        self.pose_estimated: NDArray[np.float64] = np.zeros(3) if pose is None else pose
        self.variance: NDArray[np.float64] = np.zeros(3)
        self.covariance: NDArray[np.float64] = np.zeros((3, 3))
        self.count = 1
        self.ignored_odometry = 0
        self.ignored_readings = 0

    @property
    def particles(self) -> NDArray[np.float64]:
        """View ``(1, 3)``: the estimate itself."""
        return self.pose_estimated[np.newaxis]

    @property
    def weights(self) -> NDArray[np.float64]:
        """``(1,)``: there is no doubt."""
        return np.ones(1)

    def cluster_places(self) -> NDArray[np.float64]:
        """As ``AMCL.cluster_places``: all of the weight is at the estimate."""
        return np.array([[1.0, *self.pose_estimated[:2]], [0.0, 0.0, 0.0]])

    def reset(
        self,
        pose: ArrayLike,
        state: State | None = None,
        pose_odometry: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Start at ``pose`` (m, m, rad; map frame); the other arguments are not needed."""
        self.set_truth(pose)

    def set_truth(self, pose: ArrayLike) -> None:
        """Hand over the true pose (m, m, rad; map frame); raises ValueError if not finite."""
        truth = np.array(pose, dtype=np.float64)
        if truth.shape != (3,) or not np.isfinite(truth).all():
            raise ValueError(f"pose must be three finite numbers x, y, yaw, not {pose!r}")
        truth[2] = wrap(truth[2])
        self.pose_estimated[:] = truth

    def update(
        self,
        pose_odometry: NDArray[np.float64],
        ranges: NDArray[np.float32],
        bearings: NDArray[np.float32],
    ) -> bool:
        """Nothing to learn from sensors; always True."""
        return True
