"""What watchdog, landing detection, state estimation and battery checks compute: samples and times in, verdicts out.

Pure: no ROS, no clock, no I/O, no threads. The nodes feed it live, the replay from a bag, the simulation from a model.
Limits come from `specs`, errors from `errors`. docs/monitoring.md says what is judged how, with figures.
"""

from __future__ import annotations

from .battery import BatteryMonitor, BatteryVerdict
from .condition import FOREVER_NS, Condition, Level
from .landing import LandingDetector, LandingVerdict
from .rate import RateMonitor
from .restart import RestartRequest
from .state_estimation import Estimate, StateEstimationMonitor, StateVerdict
from .watchdog import Streams, TakeoffCheck, Watchdog

__all__ = [
    "FOREVER_NS",
    "BatteryMonitor",
    "BatteryVerdict",
    "Condition",
    "Estimate",
    "LandingDetector",
    "LandingVerdict",
    "Level",
    "RateMonitor",
    "RestartRequest",
    "StateEstimationMonitor",
    "StateVerdict",
    "Streams",
    "TakeoffCheck",
    "Watchdog",
]
