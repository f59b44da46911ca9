#!/usr/bin/env python3
"""What happens to a flight: failures of components and of peers, the user, the pilot."""

from __future__ import annotations

from behaviours import Behaviours
from hitches import allowed_s
from stack import PREFLIGHT, Stack

from amaze_autonomy.engine.events import AutopilotStatus, WatchdogAction
from amaze_autonomy.engine.rules import Code

BEFORE = ["data_recorder/start", "mission_planner/load"]
S = 1_000_000_000
flights = Behaviours()


def code_seen_ns(stack: Stack, component: str, code: Code) -> int:
    """When the engine first heard of a component at a code."""
    for event in stack.events(WatchdogAction):
        if any(each.name == component and each.code is code for each in event.components):
            return event.t_ns
    raise AssertionError(f"{component} was never at {code!r}")


def assert_within(stack: Stack, name: str, after_ns: int, earliest_s: float, latest_s: float) -> None:
    """A request reached the vehicle's side within a time after something."""
    delay_s = (stack.wait_received(name).t_ns - after_ns) / S
    assert earliest_s <= delay_s <= allowed_s(latest_s, after_ns / S), (
        f"{name} came after {delay_s:.4f} s, not within {earliest_s}..{latest_s} s"
    )


def fault(target: str, kind: str, after: str = "mission", delay_s: float = 0.3, more: str = "") -> str:
    """A scenario with one fault in flight."""
    about = f"{target}\n    fault: {kind}" if target else f"fault: {kind}"
    trigger = f"after: {{event: {after}, delay_s: {delay_s}}}"
    return f"description: {kind} in flight\nfaults:\n  - {about}\n    {trigger}\n{more}"


SOON_S = 0.2  # at once, on a machine that flies all of these at the same time; how fast: test/bench/latency.py
WAY = (
    "MISSION_INPUT",
    "PREFLIGHT",
    "READY",
    "START_RECORDING",
    "LOAD_MISSION",
    "TAKEOFF",
    "MISSION",
    "DATA_CLEANUP",
    "MISSION_ENDED",
)
SHORT = (
    "MISSION_INPUT",
    "PREFLIGHT",
    "READY",
    "LOAD_MISSION",
)  # may be over before they are shown, which is of the latest state


@flights.add("takeoff")
def nominal_mission(stack: Stack) -> None:
    stack.wait_state("MISSION_ENDED")
    assert stack.passed == [each for each in WAY if each in stack.passed or each not in SHORT], stack.passed
    received = [each.name for each in stack.received()]
    assert sorted(received[:5]) == sorted(PREFLIGHT)
    assert received[5] == "data_recorder/start"
    assert sorted(received[6:12]) == sorted(["mission_planner/load", *PREFLIGHT])
    assert received[12:] == ["TAKEOFF", "data_recorder/stop"]
    times = {each.name: each.t_ns for each in stack.received()}
    assert times["TAKEOFF"] - times["data_recorder/start"] >= 0.2 * S, "the recording's lead time was not waited for"
    assert stack.states[-1].result == "COMPLETE"
    assert len({each.session for each in stack.received() if each.session}) == 1


@flights.add("next_takeoff", mission="two", night=True)
def repetitions_touch_down_and_take_off_again(stack: Stack) -> None:
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "mission_planner/load", "TAKEOFF", "data_recorder/stop"]
    assert stack.states[-1].result == "COMPLETE"


@flights.add("land", faults=fault("component: mission_camera", "killed"))
def highest_failure_lands_at_once(stack: Stack) -> None:
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "LAND", "data_recorder/stop"]
    assert_within(stack, "LAND", code_seen_ns(stack, "mission_camera", Code.ABORT), 0.0, SOON_S)
    assert stack.states[-1].result == "LANDED_EARLY"


@flights.add("land", faults=fault("component: imu", "unhealthy"), night=True)
def failure_of_the_autopilots_imu_lands_at_once(stack: Stack) -> None:
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "LAND", "data_recorder/stop"]
    assert_within(stack, "LAND", code_seen_ns(stack, "imu", Code.ABORT), 0.0, SOON_S)


@flights.add("hold", faults=fault("component: lrf", "killed", more="    restart: fails\n"), mission="long")
def high_failure_holds_then_lands(stack: Stack) -> None:
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "HOLD", "LAND", "data_recorder/stop"]
    seen_ns = code_seen_ns(stack, "lrf", Code.HOLD)
    assert_within(stack, "HOLD", seen_ns, 0.0, SOON_S)
    assert_within(stack, "LAND", seen_ns, 2.9, 3.2)


@flights.add("resume", faults=fault("component: lrf", "silent", more="    for_s: 1.5\n"), mission="hop")
def high_failure_that_comes_back_goes_on(stack: Stack) -> None:
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "HOLD", "RESUME", "data_recorder/stop"]
    assert_within(stack, "HOLD", code_seen_ns(stack, "lrf", Code.HOLD), 0.0, SOON_S)
    assert stack.states[-1].result == "COMPLETE"


@flights.add("hold", faults=fault("component: realsense_camera", "killed", more="    restart: fails\n"), night=True)
def moderate_failure_holds_then_continues(stack: Stack) -> None:
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "HOLD", "RESUME", "data_recorder/stop"]
    seen_ns = code_seen_ns(stack, "realsense_camera", Code.INCONVENIENT)
    assert_within(stack, "HOLD", seen_ns, 0.0, SOON_S)
    assert_within(stack, "RESUME", seen_ns, 2.9, 3.2)
    assert stack.states[-1].result == "COMPLETE"


@flights.add(faults=fault("component: gps", "unhealthy"), night=True)
def low_failure_only_warns(stack: Stack) -> None:
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "data_recorder/stop"]
    assert any(failure.name == "gps" for message in stack.states for failure in message.failures)
    assert stack.states[-1].result == "COMPLETE"


@flights.add(
    "hold",
    faults=fault("component: realsense_camera", "flapping", more="    off_s: 1.6\n    on_s: 2.0\n    restart: fails\n"),
    mission="long",
    night=True,
)
def flapping_component_spends_its_budget(stack: Stack) -> None:
    stack.wait(lambda: len(stack.decisions("hold")) >= 2, "the second hold", 30.0)
    stack.wait(lambda: _flies_on_without(stack), "flying on without it", 30.0)
    holds = len([each for each in stack.received() if each.name == "HOLD"])
    stack.wait(lambda: _failures_after(stack) >= 2, "two more failures", 30.0)
    assert len([each for each in stack.received() if each.name == "HOLD"]) == holds, (
        "held again for what it flies without"
    )
    assert "LAND" not in stack.commands()
    stack.ask("land")
    stack.wait_over()


@flights.add(
    "user_land",
    faults=fault("", "land_switch", more="    for_s: 2.0\n"),
    mission="long",
    overrides=("autopilot.land_switch.channel=7",),
)
def switch_of_the_transmitter_lands(stack: Stack) -> None:
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "LAND", "data_recorder/stop"]
    assert stack.states[-1].result == "LANDED_EARLY"
    assert "the switch of the transmitter says land" in stack.log()
    assert "Landing as the transmitter's land switch says." in stack.log()


def _flies_on_without(stack: Stack) -> bool:
    return any(
        failure.name == "realsense_camera" and failure.action == "continue" and failure.code == Code.INCONVENIENT
        for message in stack.states
        for failure in message.failures
    )


def _failures_after(stack: Stack) -> int:
    """How often the component failed again after it was flown on without."""
    codes = [
        any(failure.name == "realsense_camera" and failure.action == "continue" for failure in message.failures)
        for message in stack.states
        if message.in_flight
    ]
    return sum(1 for before, now in zip(codes, codes[1:]) if now and not before)


@flights.add("land_by_both_routes", faults=fault("process: mission_planner", "silent"), mission="long")
def silent_planner_lands_by_both_routes(stack: Stack) -> None:
    stack.wait_over()
    lost = next(iter(stack.decisions("land_by_both_routes")), None)
    assert lost is not None, "no landing by both routes"
    assert [command.split("(")[0] for command in lost.commands] == ["MissionCommand", "AutopilotLand"]
    delays = stack.routes_after(lost.t_ns)
    assert set(delays) == {"LAND", "autopilot/land"}
    assert all(delay < allowed_s(SOON_S, lost.t_ns / S) for delay in delays.values()), (
        f"landing was sent after {delays}"
    )


@flights.add("land", faults=fault("", "battery_drops", more="    to_fraction: 0.1\n"), mission="long", night=True)
def critical_battery_lands(stack: Stack) -> None:
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "LAND", "data_recorder/stop"]
    low = next(e for e in stack.events(AutopilotStatus) if e.battery_fraction is not None and e.battery_fraction < 0.15)
    assert_within(stack, "LAND", low.t_ns, 0.0, SOON_S)


@flights.add("land", overrides=("missions.missions.hop.limits.max_flight_time_s=11.0",), night=True)
def longest_flight_time_lands(stack: Stack) -> None:
    stack.wait_state("MISSION")
    stack.ask("hold")
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "HOLD", "LAND", "data_recorder/stop"]
    assert_within(stack, "LAND", stack.wait_received("TAKEOFF").t_ns, 10.9, 11.2)


@flights.add("pilot_took_over", faults=fault("", "pilot_takes_over", more="    land_after_s: 1.0\n"), mission="long")
def pilot_takes_over_and_is_left_alone(stack: Stack) -> None:
    stack.wait_state("PILOT")
    stack.wait(lambda: not stack.states[-1].in_flight, "the pilot's landing")
    assert stack.commands() == [*BEFORE, "TAKEOFF"], "something was commanded while the pilot flew"
    assert stack.state == "PILOT"
    assert stack.ask("acknowledge")[0] == 1
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "data_recorder/stop"]
    assert stack.states[-1].result == "PILOT"


@flights.add("user_hold", mission="long")
def user_holds_and_resumes(stack: Stack) -> None:
    stack.wait_state("MISSION")
    assert stack.ask("hold")[0] == 1
    stack.wait(lambda: stack.state == "HOLD" and stack.states[-1].step == "holding", "HOLD, holding")
    assert stack.ask("go")[0] == 2
    assert stack.ask("resume")[0] == 1
    stack.wait_state("MISSION")
    assert stack.ask("land")[0] == 1
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "HOLD", "RESUME", "LAND", "data_recorder/stop"]
    assert stack.states[-1].result == "LANDED_EARLY"


@flights.add(
    "land",
    mission="long",
    overrides=("autonomy.failsafe.watchdog_heartbeat_limit_s=0.6",),
    processes=("landing_detection,state_estimation,autopilot,mission_planner,data_recorder", "watchdog"),
)
def killed_watchdog_means_landing(stack: Stack) -> None:
    stack.wait_state("MISSION")
    stack.peers[1].kill()
    stack.peers[1].wait()
    stack.wait_over()
    assert stack.commands() == [*BEFORE, "TAKEOFF", "LAND", "data_recorder/stop"]
    assert_within(stack, "LAND", stack.events(WatchdogAction)[-1].t_ns, 0.58, 0.7)


@flights.add(
    "land_second_route",
    "land_repeat",
    faults=fault("service: mission_planner/command", "hangs", after="airborne", delay_s=0.0),
    mission="long",
)
def landing_that_the_planner_ignores_takes_the_second_route(stack: Stack) -> None:
    stack.wait_state("MISSION")
    stack.ask("land")
    stack.wait_over()
    lands = [each.t_ns for each in stack.received() if each.name == "LAND"]
    second = stack.wait_received("autopilot/land").t_ns
    assert 0.9 <= (second - lands[0]) / S <= 1.2, "the second route takes over after a second here"
    gaps = [(after - before) / S for before, after in zip(lands, lands[1:])]
    assert gaps, "LAND was sent only once"
    assert all(0.4 <= gap <= 0.65 for gap in gaps), f"LAND is repeated twice a second, not after {gaps}"


if __name__ == "__main__":
    flights.main("amaze_autonomy", "flights")
