"""A planner or autopilot node that stood still: it listens before it commands, and only a landing does not wait."""

from __future__ import annotations

import socket

import pytest
from autopilot_tools import Recorder, UdpVehicle, beat, free_port
from client_bench import ClientBench
from flying import ARDUPILOT, MS, PX4, SET_MODE, Recorded, S, stand_still

from amaze_autonomy.autopilot import Connection, Identity
from amaze_autonomy.autopilot.link import connection
from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.autopilot.vehicle.agreement import (
    DRAIN_NS,
    KEPT_NS,
    MODE_NS,
    READ_NS,
    STALL_NS,
    UNREAD_NS,
    Attention,
)
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase

P, A = MissionPhase, MissionAction
EACH = pytest.mark.parametrize("kind", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
LOOK_NS = 50 * MS  # it is looked 20 times a second


def latest_ns(stood_ns):
    """When a landing goes out at the latest: what was said in a second is kept, after more a mode is waited for."""
    return (READ_NS if stood_ns <= KEPT_NS else MODE_NS) + LOOK_NS


def hears_nothing(flying, duration_ns, happens=lambda: None):
    """Have it stand still, with nothing of the vehicle left in its socket; half way through something happens."""
    for number in range(duration_ns // (50 * MS)):
        if number == duration_ns // (100 * MS):
            happens()
        flying.channel.t_ns += 50 * MS
        flying.vehicle.wake(flying.t_ns)
    woken_ns = flying.t_ns
    flying.channel.ours(flying.planner.wake(woken_ns))
    return woken_ns


def under_way(action, kind=PX4):
    """Fly, and have a command sent that the vehicle does not follow yet."""
    flying = Recorded(kind=kind)
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    if action is A.RESUME:
        assert flying.command(A.HOLD) == ""
        flying.until_phase(P.HOLDING)
    flying.craft.flags.ignores = ("AUTO.MISSION", "AUTO.LOITER", "AUTO.LAND")
    assert flying.command(action) == ""
    flying.run(200 * MS)
    return flying


def obeys(flying):
    flying.craft.flags.ignores = ()


@EACH
@pytest.mark.parametrize("read", [stand_still, hears_nothing])
@pytest.mark.parametrize("stood_ms", [600, 1000, 1500, 4000])
def test_what_was_under_way_is_not_sent_over_a_pilot_who_took_over_meanwhile(kind, read, stood_ms):
    flying = under_way(A.RESUME, kind)
    obeys(flying)
    flying.craft.pilot_takes_over("POSCTL", 60 * S)
    woken_ns = read(flying, stood_ms * MS)
    flying.run(3 * S)
    assert (flying.since(woken_ns), flying.craft.mode) == ([], "POSCTL")


@EACH
@pytest.mark.parametrize(
    "read, stood_ms",
    [
        *((stand_still, stood_ms) for stood_ms in (600, 1500, 4000)),
        *((hears_nothing, stood_ms) for stood_ms in (1050, 1200, 1350, 1500, 4000)),
    ],
)
def test_a_landing_is_not_sent_over_a_pilot_whose_takeover_lies_unread_or_found_the_socket_full(kind, read, stood_ms):
    flying = under_way(A.LAND, kind)

    def taken_over():
        obeys(flying)
        flying.craft.pilot_takes_over("POSCTL", 60 * S)

    woken_ns = read(flying, stood_ms * MS, taken_over)
    flying.run(3 * S)
    assert (flying.since(woken_ns), flying.craft.mode) == ([], "POSCTL")


@EACH
@pytest.mark.parametrize("action", [A.RESUME, A.HOLD])
@pytest.mark.parametrize("stood_ms", [600, 1500, 4000])
def test_what_was_under_way_is_not_sent_over_a_landing_by_the_second_route(action, kind, stood_ms):
    flying = under_way(action, kind)

    def lands():
        obeys(flying)
        flying.craft.command_mode("AUTO.LAND")

    woken_ns = stand_still(flying, stood_ms * MS, lands)
    flying.run(3 * S)
    assert flying.since(woken_ns) == []
    assert flying.craft.mode == "AUTO.LAND" or not flying.craft.armed  # it is down already


def before_its_arming(kind=PX4):
    flying = Recorded(kind=kind)
    assert flying.load("line").accepted
    flying.craft.flags.not_ready = {"rc": "no RC"}
    assert flying.command(A.TAKEOFF) == ""
    flying.until(lambda: "arm" in flying.since(0), 10 * S)
    flying.craft.flags.not_ready = {}
    return flying


@EACH
@pytest.mark.parametrize("stood_ms", [1000, 2000, 2800, 10000])
def test_a_takeoff_that_stood_still_for_longer_than_the_engine_waits_is_given_up_on_the_ground(kind, stood_ms):
    """The engine has landed by then, and does not ask again once the vehicle is disarmed on the ground."""
    flying = before_its_arming(kind)
    woken_ns = stand_still(flying, stood_ms * MS)
    flying.run(8 * S)
    assert set(flying.since(woken_ns)) <= {"disarm", "AUTO.LAND"}
    assert (flying.phase, flying.craft.armed) == (P.FAILED, False)
    assert flying.status.message == f"the planner stood still for {stood_ms / 1000:.1f} s"


def test_a_takeoff_that_stood_still_for_a_moment_goes_on_once_the_vehicle_is_heard_anew():
    flying = before_its_arming()
    woken_ns = stand_still(flying, 600 * MS)
    flying.run(DRAIN_NS)
    assert flying.since(woken_ns) == []
    flying.until_phase(P.FLYING, limit_ns=20 * S)


def test_what_the_autopilot_node_commands_is_taken_before_a_takeoff_goes_on():
    flying = before_its_arming()
    woken_ns = stand_still(flying, 600 * MS)
    flying.channel.ours(flying.planner.other_commands(flying.t_ns, "AUTO.LAND"))
    flying.run(8 * S)
    assert set(flying.since(woken_ns)) <= {"disarm", "AUTO.LAND"}
    assert not flying.craft.armed


@pytest.mark.parametrize("stood_ms", [600, 3500])
def test_a_hold_goes_on_once_the_vehicle_is_heard_anew(stood_ms):
    flying = under_way(A.HOLD)
    woken_ns = stand_still(flying, stood_ms * MS)
    obeys(flying)
    flying.run(DRAIN_NS)
    assert flying.since(woken_ns) == []
    flying.until_phase(P.HOLDING, limit_ns=3 * S)


@EACH
@pytest.mark.parametrize("read", [stand_still, hears_nothing])
@pytest.mark.parametrize("stood_ms", [600, 1500, 4000])
def test_a_landing_waits_for_what_lies_in_the_socket_and_after_more_than_it_holds_for_a_mode(kind, read, stood_ms):
    flying = under_way(A.LAND, kind)
    woken_ns = read(flying, stood_ms * MS)
    assert flying.since(woken_ns) == []
    flying.run(latest_ns(stood_ms * MS))
    assert flying.since(woken_ns)[0] == "AUTO.LAND"


@EACH
def test_a_landing_of_a_vehicle_that_is_not_heard_is_sent_all_the_same(kind):
    flying = under_way(A.LAND, kind)
    woken_ns = hears_nothing(flying, 4 * S)
    while flying.t_ns < woken_ns + latest_ns(4 * S):
        hears_nothing(flying, 50 * MS)
    assert flying.since(woken_ns) == ["AUTO.LAND"]


def test_a_landing_that_is_asked_for_as_the_first_thing_afterwards_listens_as_well():
    for taken_over in (True, False):
        flying = under_way(A.HOLD)
        obeys(flying)
        if taken_over:
            flying.craft.pilot_takes_over("POSCTL", 60 * S)
        flying.channel.t_ns += S
        asked_ns = flying.t_ns
        assert flying.command(A.LAND) == ""
        assert flying.since(asked_ns) == []
        said = flying.vehicle.wake(flying.t_ns)
        for message in said:  # lay in the socket
            flying.channel._put(flying.channel._theirs, [message], to_vehicle=False)
        flying.run(latest_ns(S))
        assert flying.since(asked_ns) == ([] if taken_over else ["AUTO.LAND"])


def test_a_process_that_stands_still_again_and_again_lands_all_the_same():
    flying = under_way(A.LAND)
    begun_ns = flying.t_ns
    for _ in range(10):
        hears_nothing(flying, 700 * MS)
    assert len(flying.since(begun_ns)) >= 4


def test_a_flight_by_set_points_is_not_landed_for_a_pose_that_was_not_read_yet():
    flying = Recorded()
    flying.take_off("inside")
    flying.until(lambda: flying.craft.position_m[0] > 1.0)
    flying.craft.flags.ignores = ("POSCTL",)
    woken_ns = hears_nothing(flying, 3500 * MS)
    flying.run(S)
    assert "AUTO.LAND" not in flying.since(woken_ns)


def test_an_upload_goes_on_once_the_vehicle_is_heard_anew():
    flying = Recorded()
    loading, messages = flying.planner.load(flying.t_ns, LoadRequest("s1", "line", 0, 0))
    flying.channel.ours(messages)
    flying.channel.sent.clear()
    stand_still(flying, 600 * MS)
    flying.run(DRAIN_NS - 50 * MS)
    assert not [name for name in flying.channel.sent if name.startswith("MISSION_")]
    flying.until(lambda: loading.over, 20 * S)
    assert loading.accepted


# --- the autopilot node -----------------------------------------------------------------------------------------------


def landing(ignored_s=0.5):
    """Have the autopilot node land a vehicle that does not follow yet."""
    bench = ClientBench().fly(20.0)
    bench.far.craft.flags.ignores = ("AUTO.LAND",)
    bench.ask(bench.client.land)
    bench.advance(ignored_s)
    bench.far.craft.flags.ignores = ()
    return bench


def stop(bench, seconds, *, full=False):
    """Have the node stand still; return when it woke. `full`: all that the vehicle said meanwhile is lost."""
    end_ns = bench.t_ns + round(seconds * S)
    while bench.t_ns < end_ns:
        bench.far.step(bench.t_ns + S // 50)
    if full:
        bench._at = len(bench.far.heard)
    return bench.t_ns


@pytest.mark.parametrize(
    "stood_s, full", [(0.6, False), (1.0, False), (1.1, True), (1.3, True), (1.5, True), (3.0, True)]
)
def test_the_autopilot_node_does_not_land_over_a_pilot_whose_takeover_lies_unread_or_is_lost(stood_s, full):
    bench = landing()
    bench.far.craft.pilot_takes_over("POSCTL", 60 * S)
    woken_ns = stop(bench, stood_s, full=full)
    bench.transmit(bench.client.wake(woken_ns))
    bench.advance(3.0)
    assert [t_ns for t_ns in bench.commands(SET_MODE) if t_ns >= woken_ns] == []
    assert bench.far.craft.mode == "POSCTL"


@pytest.mark.parametrize("stood_s, full", [(1.0, False), (3.0, True)])
def test_the_autopilot_node_lands_as_soon_as_it_has_heard(stood_s, full):
    bench = landing()
    woken_ns = stop(bench, stood_s, full=full)
    bench.transmit(bench.client.wake(woken_ns))
    assert woken_ns not in bench.commands(SET_MODE)
    bench.advance(latest_ns(round(stood_s * S)) / S)
    assert bench.far.craft.mode == "AUTO.LAND"


@pytest.mark.parametrize("taken_over, mode, lands", [(True, "POSCTL", False), (False, "AUTO.LAND", True)])
def test_a_landing_that_is_asked_of_the_autopilot_node_as_the_first_thing_listens_as_well(taken_over, mode, lands):
    bench = ClientBench().fly(20.0)
    if taken_over:
        bench.far.craft.pilot_takes_over("POSCTL", 60 * S)
    asked_ns = stop(bench, 1.0)
    assert not bench.ask(bench.client.land).final
    bench.advance(1.0)
    late_ns = asked_ns + latest_ns(S) + 20 * MS
    assert any(asked_ns <= t_ns <= late_ns for t_ns in bench.commands(SET_MODE)) == lands
    assert bench.far.craft.mode == mode


# --- the link ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def quiet_link():
    """Return a link whose thread does not run, its client and the vehicle at the other end."""
    client, vehicle = Recorder(), UdpVehicle()
    vehicle.to = free_port()
    link = Connection(f"udpin:127.0.0.1:{vehicle.to}", Identity(1, 191), client)
    link._step()  # opens it
    yield link, client, vehicle
    vehicle.close()
    link._port.close()


@pytest.mark.live
def test_what_lies_in_the_socket_is_read_before_the_client_looks_at_the_time(quiet_link, monkeypatch):
    monkeypatch.setattr(connection, "_CATCH_UP_NS", 10 * S)  # however busy this computer is
    link, client, vehicle = quiet_link
    order = []
    client.receive = lambda _t_ns, message: order.append(message.get_type()) or ()
    client.wake = lambda _t_ns, *, read: order.append(("wake", read)) or ()
    vehicle.say(*[beat()] * 100)  # more than is read at once
    link._wake_ns = 0
    link._step()
    assert order == [*["HEARTBEAT"] * 100, ("wake", True)]


@pytest.mark.live
def test_a_vehicle_that_says_very_much_does_not_keep_the_client_from_looking_at_the_time(quiet_link, monkeypatch):
    monkeypatch.setattr(connection, "_CATCH_UP_NS", 0)
    link, client, vehicle = quiet_link
    vehicle.say(*[beat()] * 100)
    assert len(link.ask(lambda _t_ns: (client.names(), ()))) < 100
    woken = []
    client.wake = lambda _t_ns, *, read: woken.append(read) or ()
    link._wake_ns = 0
    link._step()
    assert woken == [False], "it is told that not all was read"


@pytest.mark.live
def test_what_lies_in_the_socket_is_read_before_anything_is_asked(quiet_link):
    link, client, vehicle = quiet_link
    vehicle.say(*[beat()] * 3)
    assert link.ask(lambda _t_ns: (client.names(), ())) == ["HEARTBEAT"] * 3


def later(link, seconds=6):
    """Have it be later for a link, and everything due."""
    link._heard_ns -= seconds * S
    link._wake_ns = 0
    link._step()


@pytest.mark.live
def test_looking_for_what_may_have_come_is_not_hearing_it():
    with socket.create_server(("127.0.0.1", 0)) as far:
        link = Connection(f"tcp:127.0.0.1:{far.getsockname()[1]}", Identity(1, 191), Recorder())
        link._step()
        assert link.state.opened
        later(link)
        assert link.state.problem == "silent for 5 s"
        link._port.close()


@pytest.mark.live
def test_who_waited_long_for_a_peer_does_not_take_him_for_silent():
    port = free_port(socket.SOCK_STREAM)
    link = Connection(f"tcpin:127.0.0.1:{port}", Identity(1, 191), Recorder())
    link._step()
    later(link)
    with socket.create_connection(("127.0.0.1", port), timeout=5.0):
        later(link)
        link._wake_ns = 0
        link._step()
        assert link.state.opened
        assert link._port.silence_is_loss, "he is there"
    link._port.close()


# --- attention --------------------------------------------------------------------------------------------------------


def test_a_process_that_looks_often_enough_has_not_stood_still():
    attention = Attention()
    assert [attention.look(t_ns) for t_ns in (5 * S, 5 * S + STALL_NS, 5 * S + 2 * STALL_NS)] == [0, 0, 0]
    assert attention.lands(5 * S, None)
    assert attention.commands(None)


def test_one_that_stood_still_lands_when_it_has_heard_the_vehicle_or_waited_for_that_and_then_commands():
    attention = Attention()
    attention.look(0)
    assert attention.look(2 * S, read=True) == 2 * S
    read_ns, last_ns = 2 * S + READ_NS, 2 * S + MODE_NS
    assert [attention.streams(t_ns) for t_ns in (read_ns - 1, read_ns)] == [False, True]
    assert [attention.lands(t_ns, read_ns - 1) for t_ns in (read_ns, last_ns - 1, last_ns)] == [False, False, True]
    assert not any(attention.commands(heard_ns) for heard_ns in (None, 2 * S, 2 * S + DRAIN_NS - 1))
    assert attention.commands(2 * S + DRAIN_NS)


def test_a_landing_waits_for_no_mode_where_the_socket_held_all_that_was_said():
    attention = Attention()
    attention.look(0)
    attention.look(KEPT_NS, read=True)
    read_ns = KEPT_NS + READ_NS
    assert [attention.lands(t_ns, None) for t_ns in (read_ns - 1, read_ns)] == [False, True]


def test_a_mode_that_is_heard_after_what_was_read_lets_a_landing_out():
    attention = Attention()
    attention.look(0)
    attention.look(2 * S, read=True)
    read_ns = 2 * S + READ_NS
    assert [attention.lands(read_ns, heard_ns) for heard_ns in (None, read_ns - 1, read_ns)] == [False, False, True]


@pytest.mark.parametrize("chance", [False, True])
def test_who_stands_still_again_reads_again_if_he_could_have_landed_meanwhile(chance):
    attention = Attention()
    attention.look(0)
    attention.look(2 * S, read=True)
    attention.look(2 * S + READ_NS, read=True)
    assert attention.lands(2 * S + READ_NS, 2 * S + READ_NS if chance else None) is chance
    attention.look(5 * S, read=True)
    assert attention.lands(5 * S, None) is not chance


def unread(stood_ns):
    """Return one that stood still for so long, and has not seen its socket empty; the time."""
    attention = Attention()
    attention.look(0)
    attention.look(stood_ns)
    return attention, stood_ns


@pytest.mark.parametrize("stood_ns", [KEPT_NS, 2 * S])
def test_what_is_read_long_after_waking_may_be_old_all_the_same(stood_ns):
    attention, woken_ns = unread(stood_ns)
    for t_ns in range(woken_ns, woken_ns + UNREAD_NS, READ_NS):  # a busy computer reads what came, slowly
        attention.look(t_ns)
        assert not attention.lands(t_ns, t_ns)
        assert not attention.commands(t_ns)
        assert not attention.streams(t_ns)


@pytest.mark.parametrize("stood_ns, waited_ns", [(KEPT_NS, READ_NS), (2 * S, MODE_NS)])
def test_a_socket_that_was_seen_empty_is_waited_for_from_then_on(stood_ns, waited_ns):
    attention, woken_ns = unread(stood_ns)
    empty_ns = woken_ns + UNREAD_NS // 2
    attention.look(empty_ns, read=True)
    assert not attention.lands(empty_ns + READ_NS - 1, empty_ns + READ_NS - 1)
    assert [attention.lands(empty_ns + waited_ns - 1, None), attention.lands(empty_ns + waited_ns, None)] == [
        False,
        True,
    ]
    assert not attention.commands(empty_ns + DRAIN_NS - 1)
    assert attention.commands(empty_ns + DRAIN_NS)


@pytest.mark.parametrize("stood_ns, waited_ns", [(KEPT_NS, READ_NS), (2 * S, MODE_NS)])
def test_a_landing_does_not_wait_for_ever_for_a_socket_that_is_never_empty(stood_ns, waited_ns):
    attention, woken_ns = unread(stood_ns)
    sent = []
    for t_ns in range(woken_ns, woken_ns + 2 * UNREAD_NS, 10 * MS):
        attention.look(t_ns)
        sent.append(attention.lands(t_ns, None))
    assert sent.index(True) * 10 * MS == UNREAD_NS + waited_ns
