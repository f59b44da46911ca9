"""Colours of the pictures, in one place: what is alike in two of them has the same colour."""

from __future__ import annotations

from typing import Mapping

from amaze_autonomy.engine.state import State

__all__ = ["STATE_COLOURS"]

STATE_COLOURS: Mapping[str, str] = {
    State.MISSION_INPUT.value: "#dee2e6",
    State.PREFLIGHT.value: "#a5d8ff",
    State.OUTREACH.value: "#ffd8a8",
    State.READY.value: "#b2f2bb",
    State.START_RECORDING.value: "#99e9f2",
    State.LOAD_MISSION.value: "#91a7ff",
    State.TAKEOFF.value: "#74c0fc",
    State.MISSION.value: "#69db7c",
    State.HOLD.value: "#ffe066",
    State.LAND.value: "#ffa94d",
    State.PILOT.value: "#e599f7",
    State.DATA_CLEANUP.value: "#c5b8a5",
    State.MISSION_ENDED.value: "#ced4da",
}
