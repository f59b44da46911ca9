#!/usr/bin/env python3
"""Lies, stalls and signals to the whole launch in flight: all real nodes, and a PX4 over MAVLink that the test holds.

Whatever one message says, or one process does, a flying vehicle stays in care. The same for the engine alone, in
virtual time: test/engine/test_lies.py.
"""

from __future__ import annotations

import contextlib
import socket
import sys
import threading
import time
from typing import Any, Iterator, List
from xmlrpc.client import ServerProxy

import rosgraph
import rospy
from behaviours import Behaviours
from hitches import allowed_s
from launching import (
    AT_ONCE,
    LIMIT_S,
    back,
    ended,
    flown,
    free_ports,
    in_flight,
    pid_of,
    process,
    roslaunch,
    rows,
    stopped,
    wait,
)
from one_node import wait_for, wait_for_service
from px4_vehicle import Px4Vehicle, forged
from pymavlink.dialects.v20 import common as mavlink
from stack import Stack

from amaze_autonomy import msg, srv
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import AutopilotStatus, MissionPhase, MissionStatus, VehicleLanded, WatchdogAction
from amaze_autonomy.engine.rules import Code

DONE, REFUSED = 1, 2
NS = 1_000_000_000
MISSION, LAND = "AUTO.MISSION", "AUTO.LAND"
ARM = (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
DISARM = (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
lies = Behaviours()


@lies.add(processes=(), start=False)
def parameter_of_a_stranger_is_no_command_of_a_node_that_is_started_again(stack: Stack) -> None:
    """Who reaches the master sets a driver's command in the watchdog's name, and has it started again."""
    roslaunch(stack, "flight:=simulated", "recorder:=simulated")
    wait(stack, lambda: stack.state == "MISSION_INPUT" and back(stack, "watchdog", 0), "the launch")
    bait, was = stack.folder / "run by the watchdog", pid_of(stack, "watchdog")
    driver = f"sensors.components.lrf.driver=[touch, '{bait}']"
    rospy.set_param(f"/{stack.name}/watchdog/overrides", driver)
    watchdog = ServerProxy(rosgraph.Master("/test").lookupNode(f"/{stack.name}/watchdog"))
    with contextlib.suppress(OSError):  # it may end before it answers
        watchdog.shutdown("/test", "by a stranger")
    wait(stack, lambda: back(stack, "watchdog", was), "the watchdog again")
    named = f"The parameter /{stack.name}/watchdog/overrides is ignored"
    wait(stack, lambda: bait.exists() or named in stack.log(), "what the watchdog makes of it")
    assert not bait.exists(), "a stranger's command was run"
    wait_for_service(f"/{stack.name}/watchdog/start")
    answer = rospy.ServiceProxy(f"/{stack.name}/watchdog/start", srv.StartWatchdog)(2.0, "", [])  # a look at each
    assert answer.components, answer
    assert not bait.exists(), "a stranger's command was run"


def decisions_since(stack: Stack, t_ns: int) -> List[Decision]:
    return [each for each in stack.decisions() if each.t_ns >= t_ns]


def statuses_since(stack: Stack, t_ns: int) -> List[AutopilotStatus]:
    return [each for each in stack.events(AutopilotStatus) if each.t_ns >= t_ns]


def decided(stack: Stack, *rules: str, limit_s: float = 20.0) -> Decision:
    """Wait for one of some rules; return its first decision."""
    found = lambda: next((each for each in stack.decisions() if each.rule in rules), None)  # noqa: E731
    return stack.wait(found, " or ".join(rules), limit_s)


def code_16_of_imu_lands(stack: Stack, vehicle: Px4Vehicle) -> None:
    """The flight is supervised still: the autopilot's IMU fails, and it lands at once."""
    vehicle.sensors["imu"] = False
    landed = decided(stack, "land")
    seen = next(
        each.t_ns
        for each in stack.events(WatchdogAction)
        if any(part.name == "imu" and part.code is Code.ABORT for part in each.components)
    )
    assert landed.t_ns == seen, f"landed {(landed.t_ns - seen) / NS} s after the code"
    down(stack, vehicle)


def down(stack: Stack, vehicle: Px4Vehicle) -> None:
    wait_for(lambda: not vehicle.craft.armed, "the landing", LIMIT_S)
    assert vehicle.modes[-1] == LAND, f"somebody commanded against the landing: {vehicle.modes}"
    stack.wait_over()
    assert stack.states[-1].result == "LANDED_EARLY"


@lies.add(processes=(), start=False)
def one_forged_status_in_flight_ends_no_supervision(stack: Stack) -> None:
    """First from an address of its own, which is not believed; then from ours, which is, and ends nothing."""
    with flown(stack, "mission:=long") as vehicle:
        in_flight(stack)
        began_ns = time.monotonic_ns()
        with socket.socket(type=socket.SOCK_DGRAM) as other:
            writer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
            for address in vehicle.addresses:
                for message in forged():
                    other.sendto(message.pack(writer), address)
            stack.wait(lambda: statuses_since(stack, began_ns + NS), "a second of the flight")
        assert all(each.armed for each in statuses_since(stack, began_ns)), "another address was believed"
        told_ns, seen = time.monotonic_ns(), len(stack.states)

        def wrong() -> bool:  # a starved node reads the truth behind it before it tells: said again then
            vehicle.say(*forged())
            told = statuses_since(stack, told_ns)
            return any(not each.armed and each.landed is VehicleLanded.ON_GROUND for each in told)

        wait_for(wrong, "the forged status at the engine", 20.0, period_s=1.0)
        told_ns = time.monotonic_ns()
        stack.wait(lambda: statuses_since(stack, told_ns + 2 * NS), "two seconds of the flight")
        assert all(message.in_flight for message in stack.states[seen:])
        assert (stack.state, decisions_since(stack, began_ns)) == ("MISSION", [])
        code_16_of_imu_lands(stack, vehicle)


@lies.add(processes=(), start=False)
def one_forged_mode_in_flight_gives_nobody_control(stack: Stack) -> None:
    """A heartbeat from our vehicle's own address says that its pilot flies; the next one denies it."""
    with flown(stack, "mission:=long") as vehicle:
        in_flight(stack)
        began_ns = time.monotonic_ns()

        def wrong() -> bool:  # a starved node reads the truth behind it before it tells: said again then
            vehicle.say(*forged("POSCTL", armed=True))
            return any(each.mode == "POSCTL" for each in statuses_since(stack, began_ns))

        wait_for(wrong, "the forged mode at the engine", 20.0, period_s=1.0)
        told_ns = time.monotonic_ns()
        stack.wait(lambda: statuses_since(stack, told_ns + 2 * NS), "two seconds of the flight")
        decided_since = [each.rule for each in decisions_since(stack, began_ns)]
        assert {*decided_since} <= {"takeover_suspected", "takeover_denied"}, decided_since
        assert stack.state == "MISSION"
        code_16_of_imu_lands(stack, vehicle)


@contextlib.contextmanager
def stranger(vehicle: Px4Vehicle) -> Iterator[str]:
    """A second vehicle says the system id of ours to the autopilot node; where it speaks from."""
    host, port = vehicle.addresses[0]
    other = Px4Vehicle(f"udpout:{host}:{port}")
    try:
        yield f"{host}:{other.ports[0]}"
    finally:
        other.stop()


@lies.add(processes=(), start=False)
def second_vehicle_with_our_id_forbids_takeoff_and_is_ignored_in_flight(stack: Stack) -> None:
    with flown(stack) as vehicle:
        wait(stack, lambda: any(each.armed is False for each in stack.events(AutopilotStatus)), "our vehicle")
        with stranger(vehicle) as address:
            stack.select("long")
            wait(stack, lambda: any(address in row.advice for row in rows(stack, "one vehicle")), "its address")
            assert stack.state in ("PREFLIGHT", "OUTREACH")
            assert stack.commands() == []
        in_flight(stack)
        began_ns = time.monotonic_ns()
        with stranger(vehicle) as address:
            words = f"another vehicle says system id 1, from {address}; it is ignored"
            stack.wait(lambda: words in stack.log(), "the warning")
            stack.wait(lambda: statuses_since(stack, began_ns + 3 * NS), "three seconds of the flight")
            assert all(each.armed for each in statuses_since(stack, began_ns)), "the two are mixed"
            assert decisions_since(stack, began_ns) == []
            assert stack.ask("land")[0] == DONE
            down(stack, vehicle)


@lies.add(processes=(), start=False)
def signed_flight_hears_no_vehicle_without_the_key(stack: Stack) -> None:
    """What both nodes and the vehicle say is signed (by pymavlink, on its side), and nothing else is believed."""
    with flown(stack, "mission:=long", key=bytes(range(32))) as vehicle:
        in_flight(stack)
        began_ns = time.monotonic_ns()
        with stranger(vehicle):
            stack.wait(lambda: statuses_since(stack, began_ns + 3 * NS), "three seconds of the flight")
        assert all(each.armed for each in statuses_since(stack, began_ns)), "the two are mixed"
        assert decisions_since(stack, began_ns) == []
        assert "another vehicle" not in stack.log()
        assert stack.ask("land")[0] == DONE
        down(stack, vehicle)
    assert all((stack.folder / f"mavlink.key.{component}.stamp").exists() for component in (191, 192))


@lies.add(processes=(), start=False)
def code_16_while_the_engine_is_stopped_lands_when_it_goes_on(stack: Stack) -> None:
    """Stopped for 0.7 s, from the first word of the autopilot on; the watchdog asks for a second one."""
    failed, alarmed = threading.Event(), threading.Event()

    def see_status(message: Any) -> None:
        if message.imu == msg.AutopilotStatus.SENSOR_FAILED:
            failed.set()

    def see_action(message: Any) -> None:
        if message.code == Code.ABORT:
            alarmed.set()

    rospy.Subscriber(f"/{stack.name}/autopilot/status", msg.AutopilotStatus, see_status, tcp_nodelay=True)
    rospy.Subscriber(f"/{stack.name}/watchdog/action", msg.WatchdogAction, see_action, tcp_nodelay=True)
    with flown(stack, "mission:=long") as vehicle:
        in_flight(stack)
        vehicle.sensors["imu"] = False
        assert failed.wait(20.0)
        with stopped(stack, "autonomy"):
            stopped_ns = time.monotonic_ns()
            assert alarmed.wait(20.0)
            time.sleep(max(0.0, 0.7 - (time.monotonic_ns() - stopped_ns) / NS))
            went_on_ns = time.monotonic_ns()
        wait_for(lambda: vehicle.modes[-1] == LAND, "the landing mode")
        assert (time.monotonic_ns() - went_on_ns) / NS < allowed_s(1.0, went_on_ns / NS)
        first = decided(stack, "land")
        assert stopped_ns <= first.t_ns < went_on_ns, "it was not among what waited"
        assert "imu" in [value.value for value in first.values], first
        down(stack, vehicle)


def in_the_pilots_hands(vehicle: Px4Vehicle, land_after_ns: int) -> None:
    """Let the pilot take over; he lands after that time."""
    with vehicle.lock:
        vehicle.craft.flags.ignores = ()
        vehicle.craft.pilot_takes_over("POSCTL", land_after_ns)


def kept_by_the_pilot(stack: Stack, vehicle: Px4Vehicle) -> None:
    """Wait for the end: nobody has commanded over him."""
    ended(stack)
    assert stack.result()["result"] == "PILOT"
    assert vehicle.modes[-1] == "POSCTL", f"somebody commanded against the pilot: {vehicle.modes}"


@lies.add(processes=(), start=False)
def planner_that_stood_still_resumes_nothing_over_the_pilot(stack: Stack) -> None:
    """It is told to resume while it is stopped; when it goes on, the takeover lies unread in its socket as well."""
    with flown(stack, "mission:=long", "unattended:=true", "exit_when_ended:=true") as vehicle:
        in_flight(stack)
        assert stack.ask("hold")[0] == DONE
        decided(stack, "hold_confirmed")
        with stopped(stack, "mission_planner"):
            assert stack.ask("resume")[0] == DONE
            stack.wait(lambda: any("RESUME" in text for each in stack.decisions() for text in each.commands), "RESUME")
            in_the_pilots_hands(vehicle, 6 * NS)
            decided(stack, "pilot_took_over")
        kept_by_the_pilot(stack, vehicle)


@lies.add(processes=(), start=False)
def planner_and_autopilot_node_that_stood_still_land_nothing_over_the_pilot(stack: Stack) -> None:
    """One for so long that its socket was full when he took over, the other, landing meanwhile, for a moment."""
    with flown(stack, "mission:=long", "unattended:=true", "exit_when_ended:=true") as vehicle:
        in_flight(stack)
        vehicle.craft.flags.ignores = (LAND,)
        with stopped(stack, "mission_planner"):
            decided(stack, "land_by_both_routes")
            with stopped(stack, "autopilot"):
                in_the_pilots_hands(vehicle, 6 * NS)
                time.sleep(0.7)  # the moment is the point: a stall that is noticed
        kept_by_the_pilot(stack, vehicle)


BEATS = """\
import sys, rospy
from amaze_autonomy.msg import WatchdogAction
rospy.init_node(sys.argv[1])
said = rospy.Publisher(sys.argv[2], WatchdogAction, queue_size=1)
rate, action = rospy.Rate(5), WatchdogAction(code=1, loop_counter=int(sys.argv[3]))
while not rospy.is_shutdown():
    action.header.stamp = rospy.Time.now()
    said.publish(action)
    rate.sleep()
"""


@lies.add(processes=(), start=False)
def two_heartbeats_whose_counters_stand_are_none(stack: Stack) -> None:
    topic = f"/{stack.name}/watchdog/action"
    with flown(stack, "mission:=long") as vehicle, contextlib.ExitStack() as beside:
        in_flight(stack)
        for name, counter in (("beats_low", "7"), ("beats_high", "900000000")):
            beside.enter_context(process(sys.executable, "-c", BEATS, f"{stack.name}_{name}", topic, counter))
        who = lambda: {each.publisher for each in stack.events(WatchdogAction)}  # noqa: E731
        stack.wait(lambda: len(who()) == 3, "three publishers of the heartbeat")
        assert stack.state == "MISSION"
        beside.enter_context(stopped(stack, "watchdog"))
        lost = decided(stack, "land", limit_s=12.0)
        assert "heartbeat" in str(lost.values), lost
        down(stack, vehicle)


FAILS_IN_LANDING = """\
description: the range finder dies in the planner's own landing
faults:
  - {component: lrf, fault: killed, restart: fails, after: {event: land, delay_s: 0.5}}
"""
SLOWLY_DOWN = ("missions.flight.landing_speed_m_s=0.25",)


def by_its_own_vehicle(stack: Stack, faults: str, *arguments: str, overrides: Any = ()) -> None:
    """Start it with the vehicle of the simulation, and a scenario."""
    (stack.folder / "faults.yaml").write_text(faults)
    given = (f"faults:={stack.folder / 'faults.yaml'}", f"received:={stack.folder / 'received.jsonl'}")
    roslaunch(stack, f"mavlink_port:={free_ports()}", *given, *arguments, overrides=overrides)


@lies.add(processes=(), start=False)
def nothing_holds_the_planners_own_landing(stack: Stack) -> None:
    by_its_own_vehicle(stack, FAILS_IN_LANDING, "mission:=hop", overrides=SLOWLY_DOWN)
    in_flight(stack)
    lands = lambda: [each for each in stack.events(MissionStatus) if each.phase is MissionPhase.LANDING]  # noqa: E731
    stack.wait(lands, "the planner's landing")
    assert stack.ask("hold") == (REFUSED, "It is landing: a hold never interrupts that.")
    stack.wait(lambda: "The landing goes on." in stack.log(), "the failure of the range finder")
    stack.wait_over()
    assert not any("HOLD" in text for each in stack.decisions() for text in each.commands)
    assert stack.states[-1].result == "COMPLETE"


@lies.add(processes=(), start=False)
def planner_that_says_holding_while_the_vehicle_flies_on_is_not_believed(stack: Stack) -> None:
    lying: Any = rospy.Publisher(f"/{stack.name}/mission_planner/status", msg.MissionStatus, queue_size=1)
    held = threading.Event()

    def lie(message: Any) -> None:
        if held.is_set() and message.phase != message.HOLDING:
            message.phase = message.HOLDING
            lying.publish(message)

    rospy.Subscriber(f"/{stack.name}/mission_planner/status", msg.MissionStatus, lie, tcp_nodelay=True)
    with flown(stack, "mission:=far") as vehicle:
        in_flight(stack)
        stack.wait(
            lambda: (stack.events(AutopilotStatus)[-1].horizontal_speed_m_s or 0.0) > 2.0, "one on its way", LIMIT_S
        )
        vehicle.craft.flags.ignores = ("AUTO.LOITER",)
        held.set()
        asked_ns = time.monotonic_ns()
        assert stack.ask("hold")[0] == DONE
        landed = decided(stack, "hold_unconfirmed", "hold_refused")
        told = [text for each in decisions_since(stack, asked_ns) for text in each.commands if "HOLD" in text]
        assert len(told) == 2, f"asked again, once: {told}"
        assert "hold_confirmed" not in [each.rule for each in stack.decisions()]
        said = [each for each in stack.events(MissionStatus) if asked_ns < each.t_ns < landed.t_ns]
        assert any(each.phase is MissionPhase.HOLDING for each in said)
        down(stack, vehicle)


@lies.add(processes=(), start=False)
def operator_ends_a_mission_whose_autopilot_node_is_dead_for_good(stack: Stack) -> None:
    with flown(stack, "mission:=long") as vehicle:
        in_flight(stack)
        with stopped(stack, "autopilot"):
            decided(stack, "autopilot_lost_alarm")
            wait_for(lambda: not vehicle.craft.armed, "the planner's landing", LIMIT_S)
            assert stack.state == "LAND"
            wait_for(lambda: stack.ask("acknowledge")[0] == DONE, "an acknowledgement that is taken", period_s=1.0)
            stack.wait_received("data_recorder/stop")
            stack.wait_state("MISSION_ENDED", limit_s=LIMIT_S)
        assert "Acknowledged: whether the vehicle has landed is not known." in stack.log()
        assert decided(stack, "landing_given_up")


@lies.add(processes=(), start=False)
def link_that_is_cut_at_the_arming_is_landed_for_and_nothing_goes_on_afterwards(stack: Stack) -> None:
    with flown(stack, "mission:=long") as vehicle:
        wait(stack, lambda: vehicle.craft.armed, "the arming")
        vehicle.cut = True
        decided(stack, "land_by_both_routes", limit_s=LIMIT_S)
        assert vehicle.craft.armed
        before, vehicle.cut = len(vehicle.commands), False
        wait_for(lambda: not vehicle.craft.armed, "the disarming")  # by itself: 10 s after its arming
        stack.wait_over()
        assert stack.states[-1].result in (
            "LANDED_EARLY",
            "NOT_FLOWN",
        )  # as it was heard armed before it disarmed, or not
        assert vehicle.craft.height_m == 0.0
        assert MISSION not in vehicle.modes, f"the takeoff went on: {vehicle.modes}"
        assert ARM not in vehicle.commands[before:], "it was armed once more"


@lies.add(processes=(), start=False)
def vehicle_whose_ground_is_no_longer_told_is_not_disarmed_in_the_air(stack: Stack) -> None:
    """The last that it says of the ground is that it stands there: its takeoff fails in the air, and is landed for."""
    with flown(stack, "mission:=long") as vehicle:
        wait(stack, lambda: vehicle.craft.armed, "the arming")
        vehicle.unsaid.add("EXTENDED_SYS_STATE")
        wait_for(lambda: vehicle.craft.airborne, "the lift-off")
        wait_for(lambda: LAND in vehicle.modes, "the landing mode", LIMIT_S)
        wait_for(lambda: not vehicle.craft.armed, "the landing", LIMIT_S)  # PX4 disarms by itself
        assert DISARM not in vehicle.commands, "it was disarmed on a ground that it had told before"
        told = {each.landed for each in stack.events(AutopilotStatus)}
        assert told <= {VehicleLanded.ON_GROUND, VehicleLanded.UNKNOWN}, "it told that it had left the ground: again"
        vehicle.unsaid.clear()
        down(stack, vehicle)


@lies.add(processes=(), start=False)
def reason_why_arming_is_refused_reaches_the_operator(stack: Stack) -> None:
    """In the autopilot's own words, where it tells them: PX4 withholds them on a link without a ground station."""
    with flown(stack, "mission:=long", overrides=("autopilot.planner_link.ground_station=true",)) as vehicle:
        vehicle.refusal = "the hatch is open"
        shown = lambda: [each.message for each in stack.states if each.state == "OUTREACH"]  # noqa: E731
        wait(stack, lambda: any("Arming denied: the hatch is open" in each for each in shown()), "the reason")
        assert ARM in vehicle.commands


@lies.add(processes=(), start=False)
def pilot_keeps_a_vehicle_whose_imu_fails_and_an_unattended_run_ends(stack: Stack) -> None:
    with flown(stack, "mission:=long", "unattended:=true", "exit_when_ended:=true") as vehicle:
        in_flight(stack)
        with vehicle.lock:
            vehicle.craft.pilot_takes_over("POSCTL", 4 * NS)
        vehicle.sensors["imu"] = False
        ended(stack)
        result = stack.result()
        assert (result["exit_status"], result["result"]) == (4, "PILOT")
        assert LAND not in vehicle.modes, "somebody commanded against the pilot"
        told = [text for each in stack.decisions() for text in each.commands if "LAND" in text or "Land" in text]
        assert told == []


@lies.add(processes=(), start=False)
def link_that_loses_a_fifth_ends_no_flight_and_somebody_elses_landing_is_left_alone(stack: Stack) -> None:
    with flown(stack, "mission:=long", "unattended:=true", "exit_when_ended:=true") as vehicle:
        in_flight(stack)
        lossy_ns, vehicle.lost_fraction = time.monotonic_ns(), 0.2
        stack.wait(lambda: statuses_since(stack, lossy_ns + 8 * NS), "eight seconds over a link that loses a fifth")
        assert (stack.state, decisions_since(stack, lossy_ns)) == ("MISSION", [])
        with vehicle.lock:
            vehicle.craft.pilot_takes_over(LAND, 0)
        decided(stack, "pilot_took_over")
        vehicle.sensors["imu"] = False
        ended(stack)
        assert stack.result()["result"] == "PILOT"
        told = [text for each in decisions_since(stack, lossy_ns) for text in each.commands]
        assert not any(word in text for text in told for word in ("HOLD", "LAND", "Land")), told


CRITICAL = """\
description: the battery gets critical, and the autopilot does nothing about it
faults:
  - {fault: battery_drops, to_fraction: 0.05, after: {event: mission, delay_s: 1.0}}
"""


@lies.add(processes=(), start=False)
def ardupilot_at_a_critical_battery_that_it_leaves_alone_is_landed(stack: Stack) -> None:
    by_its_own_vehicle(stack, CRITICAL, "mission:=long", "vehicle:=ardupilot")
    in_flight(stack)
    decided(stack, "land")
    stack.wait_over()
    assert "PILOT" not in stack.passed
    assert stack.states[-1].result == "LANDED_EARLY"


if __name__ == "__main__":
    lies.main("amaze_autonomy", "lies", at_once=AT_ONCE)
