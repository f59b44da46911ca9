"""A run as expectations and pages see it, read from its journal."""

from __future__ import annotations

from amaze_autonomy.engine.events import AutopilotStatus, VehicleLanded
from amaze_autonomy.journal.trace import READINGS, trace_of


def test_a_reading_is_what_the_autopilot_says_and_nothing_where_it_says_nothing():
    known = {"armed": True, "landed": VehicleLanded.IN_AIR}
    said = AutopilotStatus(t_ns=1, height_m=2.0, battery_fraction=0.5, **known)
    readings = trace_of(
        (said, AutopilotStatus(t_ns=2, **known), AutopilotStatus(t_ns=3, height_m=0.0, **known))
    ).readings
    assert tuple(readings) == READINGS
    assert readings["height_m"] == ((1, 2.0), (3, 0.0))
    assert {name: values for name, values in readings.items() if values and name != "height_m"} == {
        "battery_fraction": ((1, 0.5),)
    }
