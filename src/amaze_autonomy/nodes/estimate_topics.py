"""The kinds of messages that a state estimate may come in."""

from __future__ import annotations

from typing import Any, Mapping, Type

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from amaze_autonomy.monitoring.specs import EstimateSource

__all__ = ["ESTIMATE_MESSAGES"]

ESTIMATE_MESSAGES: Mapping[EstimateSource, Type[Any]] = {
    EstimateSource.ODOMETRY: Odometry,
    EstimateSource.POSE: PoseStamped,
    EstimateSource.POSE_WITH_COVARIANCE: PoseWithCovarianceStamped,
}
