"""The scripted world: a planner, a recorder and a vehicle that do at once what they are told."""

from __future__ import annotations

from amaze_autonomy.engine.commands import LoadMission, MissionAction, StartRecording, StopRecording
from amaze_autonomy.engine.events import MissionPhase, RecordingPhase, VehicleLanded
from amaze_autonomy.replay.peers.script import Planner, Recorder, Vehicle

S = 1_000_000_000


def story(vehicle, told=None):
    """Return (armed, landed, height) each second from 10 s to 20 s."""
    facts = [vehicle.facts(t * S, told or {}) for t in range(10, 21)]
    return [(each["armed"], each["landed"].name, each["height_m"]) for each in facts]


def test_a_vehicle_that_was_told_nothing_stands_on_the_ground_disarmed():
    assert story(Vehicle()) == [(False, "ON_GROUND", 0.0)] * 11


def test_a_vehicle_takes_off_lands_and_disarms():
    vehicle = Vehicle()
    vehicle.command(10 * S, MissionAction.TAKEOFF)
    assert vehicle.mode == "AUTO.MISSION"
    climb = [vehicle.facts(t * S, {}) for t in (10, 11, 12, 13)]
    assert [(each["armed"], each["landed"].name, each["height_m"]) for each in climb] == [
        (False, "ON_GROUND", 0.0),
        (True, "ON_GROUND", 0.0),
        (True, "IN_AIR", 1.0),
        (True, "IN_AIR", 2.0),
    ]
    vehicle.command(14 * S, MissionAction.LAND)
    descent = [vehicle.facts(t * S, {}) for t in (14, 15, 16, 17)]
    assert vehicle.mode == "AUTO.LAND"
    assert [(each["armed"], each["landed"].name, each["height_m"]) for each in descent] == [
        (True, "LANDING", 2.0),
        (True, "LANDING", 1.0),
        (True, "ON_GROUND", 0.0),
        (False, "ON_GROUND", 0.0),
    ]


def test_what_the_recording_tells_takes_the_place_of_the_script():
    told = {"armed": True, "landed": VehicleLanded.IN_AIR, "height_m": 7.0, "battery_fraction": 0.5}
    assert Vehicle().facts(S, told) == {**told, "battery_voltage_v": None}


def test_what_the_recording_should_tell_and_does_not_is_unknown():
    facts = Vehicle().facts(S, {"armed": None, "landed": None, "height_m": None, "battery_fraction": None})
    assert facts == {
        "armed": None,
        "landed": VehicleLanded.UNKNOWN,
        "height_m": None,
        "battery_fraction": None,
        "battery_voltage_v": None,
    }


def test_a_recorded_landing_disarms_the_scripted_motors():
    vehicle = Vehicle()
    vehicle.command(10 * S, MissionAction.TAKEOFF)
    told = [{"landed": VehicleLanded.IN_AIR}, {"landed": VehicleLanded.ON_GROUND}, {"landed": VehicleLanded.ON_GROUND}]
    assert [vehicle.facts((12 + t) * S, each)["armed"] for t, each in enumerate(told)] == [True, True, False]


def test_motors_that_were_disarmed_stay_so_until_the_next_takeoff():
    vehicle = Vehicle()
    vehicle.command(10 * S, MissionAction.TAKEOFF)
    story = ["IN_AIR", "ON_GROUND", "ON_GROUND", "UNKNOWN", "IN_AIR"]
    armed = [vehicle.facts((12 + t) * S, {"landed": VehicleLanded[each]})["armed"] for t, each in enumerate(story)]
    assert armed == [True, True, False, False, False]
    vehicle.command(20 * S, MissionAction.TAKEOFF)
    assert vehicle.facts(21 * S, {})["armed"] is True


def planner_phase(planner, landed, height_m, *, armed=True):
    planner.follow({"landed": landed, "height_m": height_m, "armed": armed}, 1.0)
    return planner.phase


def test_the_planner_reads_its_phase_from_the_vehicle():
    planner = Planner()
    assert planner.status(S).phase is MissionPhase.IDLE
    planner.load(LoadMission(id=1, limit_ns=S, session_id="s-001", mission_id="1", file_index=0, repetition=0))
    status = planner.status(S)
    assert (status.phase, status.session_id, status.mission_id) == (MissionPhase.LOADED, "s-001", "1")
    planner.command(MissionAction.TAKEOFF)
    assert planner_phase(planner, VehicleLanded.IN_AIR, 0.5) is MissionPhase.TAKING_OFF
    assert planner_phase(planner, VehicleLanded.IN_AIR, 1.2) is MissionPhase.FLYING
    planner.command(MissionAction.HOLD)
    assert planner_phase(planner, VehicleLanded.IN_AIR, 1.2) is MissionPhase.HOLDING
    planner.command(MissionAction.RESUME)
    assert planner_phase(planner, VehicleLanded.ON_GROUND, 0.0) is MissionPhase.LANDING
    assert planner_phase(planner, VehicleLanded.ON_GROUND, 0.0, armed=False) is MissionPhase.LANDED


def test_the_recorder_starts_grows_and_completes():
    recorder = Recorder()
    assert recorder.status(0).phase is RecordingPhase.IDLE
    recorder.start(10 * S, StartRecording(id=1, limit_ns=S, session_id="s-001", mission_id="1"))
    early, late = recorder.status(10 * S), recorder.status(11 * S)
    assert (early.phase, early.platforms[0].growing) == (RecordingPhase.STARTING, False)
    assert (late.phase, late.platforms[0].growing, late.session_id) == (RecordingPhase.RECORDING, True, "s-001")
    recorder.stop(20 * S, StopRecording(id=2, limit_ns=S, session_id="s-001"))
    assert recorder.status(20 * S).phase is RecordingPhase.MERGING
    done = recorder.status(21 * S)
    assert (done.phase, done.progress, done.location) == (RecordingPhase.COMPLETE, 1.0, "script")
