"""Schema of sensors.yaml: what is watched, the decision table, and the checks besides the watchdog's."""

from __future__ import annotations

from .checks_schema import BATTERY, LANDING_DETECTION, STATE_ESTIMATION
from .components_schema import COMPONENT_NAME, COMPONENTS, POLLING, SEVERITY, TOPIC_NAME
from .schema import Group, Key

__all__ = ["COMPONENT_NAME", "SENSORS", "SEVERITY", "TOPIC_NAME"]

SENSORS = Group(
    "what is watched",
    (
        Key("components", COMPONENTS, "the decision table: every component, its sources and what its failure means"),
        Key("polling", POLLING, "how often nodes and drivers are asked, and how old their answers may be", "", {}),
        Key("landing_detection", LANDING_DETECTION, "is the vehicle on the ground, has it landed?", "", {}),
        Key("state_estimation", STATE_ESTIMATION, "are the states valid, does gravity point down?", "", {}),
        Key("battery", BATTERY, "is the level enough to take off? In flight: autonomy.yaml, battery", "", {}),
    ),
)
