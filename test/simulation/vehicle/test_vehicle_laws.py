"""What holds of vehicle and battery whatever they are told."""

from hypothesis import given
from hypothesis import strategies as st
from simulation_tools import Driver, scenario

from amaze_autonomy.engine.commands import (
    AutopilotDisarm,
    AutopilotLand,
    LoadMission,
    MissionAction,
    MissionCommand,
    StartRecording,
    StopRecording,
)
from amaze_autonomy.engine.events import AutopilotStatus, VehicleLanded

MOTION = st.sampled_from(MissionAction).map(lambda action: (MissionCommand, {"session_id": "a", "action": action}))
OTHER = st.sampled_from(
    [
        (AutopilotLand, {}),
        (AutopilotDisarm, {}),
        (LoadMission, {"session_id": "a", "mission_id": "1", "file_index": 0, "repetition": 0}),
        (LoadMission, {"session_id": "b", "mission_id": "9", "file_index": 5, "repetition": 0}),
        (StartRecording, {"session_id": "a", "mission_id": "1"}),
        (StopRecording, {"session_id": "a"}),
    ]
)
FAULTS = st.lists(
    st.sampled_from(
        [
            "fault: pilot_takes_over, at_s: 12, for_s: 9",
            "fault: pilot_arms, at_s: 2",
            "fault: autopilot_failsafe, at_s: 15",
            "fault: battery_drops, to_fraction: 0.1, over_s: 10, at_s: 5",
            "fault: battery_unknown, at_s: 3, for_s: 5",
            "fault: does_not_lift_off, for_s: 9",
            "fault: does_not_climb, above_m: 0.4, for_s: 20",
            "fault: ignores_mode, mode: AUTO.LAND, for_s: 30",
            "fault: does_not_disarm, for_s: 40",
            "process: mission_planner, fault: killed, at_s: 14, for_s: 3",
            "fault: autopilot_link_lost, at_s: 6, for_s: 5",
        ]
    ),
    max_size=3,
)
STEPS = st.lists(st.tuples(st.floats(0.0, 6.0), st.one_of(MOTION, OTHER)), max_size=25)


@given(FAULTS, STEPS, st.booleans())
def test_no_command_and_no_fault_breaks_the_laws_of_the_world(faults, steps, begins_in_flight):
    driver = Driver("\n".join(faults))
    if begins_in_flight and not any("lift_off" in fault or "climb" in fault or "arms" in fault for fault in faults):
        driver.take_off()
    fraction, t_ns = 1.0, 0
    for seconds, (kind, fields) in steps:
        driver.send(kind, **fields)
        for event in driver.go_on(seconds):
            assert event.t_ns >= t_ns, "events come in order of time"
            t_ns = event.t_ns
            if isinstance(event, AutopilotStatus):
                assert event.battery_fraction is None or event.battery_fraction <= fraction, "a battery gets emptier"
                fraction = event.battery_fraction or fraction
        vehicle = driver.vehicle
        assert vehicle.height_m >= 0.0
        assert vehicle.armed or not vehicle.airborne, "disarmed in the air"
        assert vehicle.airborne or vehicle.velocity_m_s == (0.0, 0.0, 0.0)
        if vehicle.airborne:
            assert vehicle.landed is not VehicleLanded.ON_GROUND
        assert 0 <= vehicle.reached <= len(vehicle.waypoints)


@given(st.integers(0, 2**31), FAULTS)
def test_the_same_seed_gives_the_same_events(seed, faults):
    story = "\n".join(faults)
    assert scenario(story) == scenario(story)
    first, second = Driver(story, seed=seed), Driver(story, seed=seed)
    for driver in (first, second):
        driver.load()
        driver.command(MissionAction.TAKEOFF)
        driver.go_on(20.0)
    assert first.events == second.events
