"""Many events as one text, and back."""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import inf, nan
from typing import Tuple

import pytest

from amaze_autonomy.engine.events import (
    AutopilotStatus,
    ComponentStatus,
    PlatformRecording,
    RecordingPhase,
    RecordingStatus,
    VehicleLanded,
    WatchdogInfo,
)
from amaze_autonomy.engine.rules import Code, Restart
from amaze_autonomy.journal.codec import bundled, unbundled

VEHICLES = [
    AutopilotStatus(t_ns=n, armed=armed, landed=landed, mode="ä\n", height_m=0.1 * n, link_age_s=None, age_ns=-n)
    for n, (armed, landed) in enumerate([(True, VehicleLanded.IN_AIR), (None, VehicleLanded.UNKNOWN)])
]
RECORDERS = [
    RecordingStatus(
        t_ns=1 << 60,
        session_id="x-001",
        phase=RecordingPhase.RECORDING,
        platforms=(PlatformRecording("a", growing=True, byte_rate=1e300), PlatformRecording("b", growing=False)),
    ),
    RecordingStatus(t_ns=2, session_id="", phase=RecordingPhase.IDLE, progress=1 / 3),
]
WATCHDOGS = [
    WatchdogInfo(
        t_ns=3,
        sequence=1,
        changed=("imu",),
        components=(ComponentStatus("imu", Code.HOLD, Restart.TRYING, 5, 'why "so"'),),
    )
]


@pytest.mark.parametrize("events", [VEHICLES, RECORDERS, WATCHDOGS, []], ids=["flat", "nested", "enums", "none"])
def test_events_come_back_as_they_were(events):
    kind = type(events[0]) if events else AutopilotStatus
    assert unbundled(kind, bundled(events)) == events
    assert [type(each) for each in unbundled(kind, bundled(events))] == [kind] * len(events)


def test_what_is_equal_is_decoded_once():
    first, second = unbundled(RecordingStatus, bundled([RECORDERS[0], RECORDERS[0]]))
    assert first.platforms is second.platforms


@pytest.mark.parametrize("text", ["", "{", "[]", '{"t_ns":[1]}', "null"])
def test_what_is_no_bundle_of_that_class_is_refused(text):
    with pytest.raises(ValueError):  # noqa: PT011  (JSON's own, or ours)
        unbundled(AutopilotStatus, text)


def test_a_bundle_of_another_version_of_a_class_is_refused():
    columns = json.loads(bundled(VEHICLES))
    del columns["mode"]
    with pytest.raises(ValueError, match=r"^no bundle of AutopilotStatus$"):
        unbundled(AutopilotStatus, json.dumps(columns))


@dataclass(frozen=True)
class Measured:
    """A class whose number need not be one, as no event's is."""

    value: float
    values: Tuple[float, ...] = ()


@pytest.mark.parametrize("wrong", [Measured(nan), Measured(0.0, (inf,))])
def test_what_is_no_number_is_not_written(wrong):
    with pytest.raises(ValueError, match="not JSON compliant"):
        bundled([Measured(0.0), wrong])
