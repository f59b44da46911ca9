"""Whatever one message of the vehicle says wrongly, both nodes go on with its flight, and a landing stands.

The same for the engine, whose peers may lie: test/engine/test_lies.py. With real nodes: test/ros/lies.py.
"""

from __future__ import annotations

import pytest
from client_bench import ClientBench
from flying import ARDUPILOT, ARM, MS, PX4, SET_MODE, Recorded, S
from hypothesis import example, given, settings
from hypothesis import strategies as st
from vehicle_lies import CLIMBING, CRITICAL, DOWN, IN_AIR, LANDING, ON_GROUND, Liar

from amaze_autonomy.autopilot.planner.flight_progress import IN_FLIGHT
from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.autopilot.vehicle.client import Reply
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase

P, A = MissionPhase, MissionAction
EACH = pytest.mark.parametrize("kind", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
BOTH = pytest.mark.parametrize("mission", ["line", "inside"])
CONFIRM_NS = S // 2  # flight_end_confirm_s


class Lied(Recorded):
    """A planner that hears lies, and what it sends."""

    def __init__(self, kind=PX4, **how) -> None:
        super().__init__(kind=kind, **how)
        self.lies = Liar(self.planner, copter=kind is ARDUPILOT)

    def forge(self, *lies) -> None:
        """Have the planner get one datagram that nobody sent."""
        self.channel.ours(self.lies.datagram(self.t_ns, *lies))

    @property
    def streamed(self) -> int:
        """How many set-points were sent."""
        return self.channel.sent.count("SET_POSITION_TARGET_LOCAL_NED")


def flying(mission, kind=PX4) -> Lied:
    """Return it on its way to the second waypoint."""
    found = Lied(kind)
    found.take_off(mission)
    found.until(lambda: found.craft.position_m[0] > 1.0)
    return found


# --- the planner: the end of a flight -----------------------------------------------------------------------------


@EACH
@BOTH
@pytest.mark.parametrize("datagrams", [1, 2, 4])
@pytest.mark.slow_rows
def test_datagrams_that_say_down_end_no_flight_however_many_any_time_apart(mission, kind, datagrams):
    lied = flying(mission, kind)
    for _ in range(datagrams):
        lied.forge(*DOWN)
        assert lied.phase is P.FLYING
        before, least = lied.streamed, {"line": 0}.get(mission, 17)
        lied.run(S)
        assert lied.streamed - before >= least
        assert (lied.phase, lied.craft.armed) == (P.FLYING, True)
    assert lied.command(A.HOLD) == ""
    lied.until_phase(P.HOLDING)
    assert lied.command(A.RESUME) == ""
    lied.until_phase(P.LANDED)
    assert (lied.status.waypoint, lied.craft.armed, lied.craft.height_m) == (3, False, 0.0)


@EACH
@BOTH
def test_the_end_of_a_flight_is_believed_once_messages_agree_on_it_for_long_enough(mission, kind):
    lied = flying(mission, kind)
    lied.until(lambda: not lied.craft.armed)
    down_ns = lied.t_ns
    lied.until_phase(P.LANDED, limit_ns=5 * S)
    assert CONFIRM_NS <= lied.t_ns - down_ns <= 2200 * MS


@EACH
def test_how_long_the_last_item_was_waited_for_is_not_kept_from_a_lie(kind):
    """Seconds of one lie and beats of another must not add up."""
    lied = flying("line", kind)
    record = lied.planner._flight
    for _ in range(3):
        lied.forge(*DOWN)
        lied.run(500 * MS)
    assert (record._ground_ns, record._beats) == (None, 0)


@EACH
@BOTH
def test_a_planner_that_was_lied_to_for_long_goes_back_to_its_flight_when_it_hears_the_truth(mission, kind):
    lied = flying(mission, kind)
    lied.lies.always(*DOWN)
    lied.until_phase(P.LANDED, limit_ns=8 * S)
    lied.run(300 * MS)
    assert lied.phase is P.LANDED
    lied.lies.always()
    lied.forge(("landed", IN_AIR), ("armed", True))  # the truth; PX4's own heartbeat may be a second away
    assert lied.phase is P.FLYING
    assert lied.command(A.HOLD) == ""
    lied.until_phase(P.HOLDING)
    assert lied.command(A.RESUME) == ""
    lied.until_phase(P.LANDED)
    assert (lied.status.waypoint, lied.craft.armed) == (3, False)


def test_a_landing_that_was_commanded_goes_on_when_its_planner_goes_back_to_the_flight():
    lied = flying("line")
    lied.craft.flags.ignores = ("AUTO.LAND",)
    assert lied.command(A.LAND) == ""
    lied.lies.always(*DOWN)
    lied.until_phase(P.LANDED, limit_ns=8 * S)
    lied.run(2 * S)
    lied.lies.always()
    lied.craft.flags.ignores = ()
    lied.until(lambda: lied.craft.mode == "AUTO.LAND", 2500 * MS)
    lied.until_phase(P.LANDED)


def test_who_is_armed_on_the_ground_after_the_landing_flies_a_flight_of_somebody_else():
    lied = flying("line")
    lied.until_phase(P.LANDED)
    lied.run(2 * S)
    lied.craft.command_mode("AUTO.LOITER")
    assert lied.craft.arm() == ""
    lied.run(S)
    lied.craft.command_mode("AUTO.TAKEOFF")
    lied.until(lambda: lied.craft.height_m > 0.8, 10 * S)
    lied.craft.command_mode("AUTO.LOITER")
    lied.run(2 * S)
    assert lied.phase is P.LANDED
    assert lied.planner.shutdown(lied.t_ns) == (False, ())


@EACH
@BOTH
def test_a_planner_that_is_told_to_end_right_after_a_lie_lands(mission, kind):
    for lies in (DOWN, DOWN[:1], DOWN[1:], (("mode", "POSCTL"),), (("status", CRITICAL),)):
        lied = flying(mission, kind)
        lied.forge(*lies)
        lands, messages = lied.planner.shutdown(lied.t_ns)
        lied.channel.ours(messages)
        assert lands, lies
        assert not lied.planner.landing_shown
        lied.until(lambda lied=lied: lied.planner.landing_shown, 3 * S)  # exit_limit_s
        assert lied.craft.mode == "AUTO.LAND"


@EACH
def test_nothing_is_loaded_into_a_flying_vehicle_that_is_said_to_be_down(kind):
    lied = flying("line", kind)
    lied.forge(*DOWN)
    loading, messages = lied.planner.load(lied.t_ns, LoadRequest("s1", "line", 0, 0))
    assert (loading.accepted, loading.refused, messages) == (False, True, ())
    assert lied.phase is P.FLYING


# --- the planner: a landing -----------------------------------------------------------------------------------------


@EACH
@BOTH
@pytest.mark.parametrize(
    "lies",
    [DOWN, DOWN[:1], DOWN[1:], [("mode", "POSCTL")], [("mode", "AUTO.RTL")], [("mode", "AUTO.LAND")]],
    ids=["down", "disarmed", "on ground", "pilot", "return", "lands"],
)
@pytest.mark.slow_rows
def test_a_landing_that_was_commanded_stands_whatever_one_message_says(mission, kind, lies):
    lied = flying(mission, kind)
    lied.craft.flags.ignores = ("AUTO.LAND",)
    assert lied.command(A.LAND) == ""
    lied.run(700 * MS)
    lied.forge(*lies)
    lied.run(300 * MS)
    lied.craft.flags.ignores = ()
    lied.until(lambda: lied.craft.mode == "AUTO.LAND", 2500 * MS)
    assert lied.command(A.HOLD) == "a landing was commanded: it stands until the vehicle is disarmed"
    lied.until_phase(P.LANDED)


@EACH
@BOTH
@pytest.mark.parametrize("lies", [DOWN, [("mode", "POSCTL")], [("mode", "AUTO.LAND")]], ids=["down", "pilot", "lands"])
def test_a_landing_that_is_asked_for_right_after_a_lie_lands(mission, kind, lies):
    lied = flying(mission, kind)
    lied.forge(*lies)
    if lied.command(A.LAND) == "the pilot has control (mode POSCTL)":
        lied.run(S // 2)  # refused at his first sign, and asked for again as the engine does
        assert lied.command(A.LAND) == ""
    lied.until(lambda: lied.craft.mode == "AUTO.LAND", 700 * MS)
    lied.until_phase(P.LANDED)


def test_a_mode_of_a_pilot_that_lasts_ends_a_landing_and_nothing_is_sent_from_its_first_sign_on():
    lied = flying("line")
    lied.craft.flags.ignores = ("AUTO.LAND",)
    assert lied.command(A.LAND) == ""
    lied.run(700 * MS)
    lied.craft.pilot_takes_over("POSCTL", 60 * S)
    lied.until(lambda: lied.planner.watch.mode == "POSCTL", S)
    seen_ns = lied.t_ns
    lied.run(3 * S)
    assert lied.since(seen_ns) == []
    assert lied.command(A.LAND) == "the pilot has control (mode POSCTL)"
    lied.craft.command_mode("AUTO.LOITER")
    lied.run(3 * S)
    assert lied.since(seen_ns) == []


# --- the planner: disarming -------------------------------------------------------------------------------------------


def test_nothing_disarms_on_one_on_ground():
    lied = Lied()
    lied.take_off("line")
    lied.until(lambda: lied.craft.height_m > 0.3)
    lied.planner._flight.airborne = False  # it was not heard lifting off
    now_ns = lied.t_ns
    lied.lies.once(("landed", ON_GROUND))
    lied.until(lambda: lied.planner.watch.on_ground(lied.t_ns, S), S)
    lied.planner._flight.airborne = False
    assert lied.command(A.ABORT) == ""
    assert lied.since(now_ns) == ["AUTO.LAND"]


# --- the planner: somebody else's landing -----------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["AUTO.LAND", "AUTO.PRECLAND"])
def test_a_landing_mode_that_nobody_of_us_commanded_is_somebody_elses_while_it_says_that_it_lands(mode):
    lied = flying("line")
    lied.lies.always(("mode", mode), ("current mode", mode), ("landed", LANDING))
    lied.run(2 * S)
    assert (lied.phase, lied.status.message) == (P.FLYING, f"somebody else lands the vehicle (mode {mode})")


def test_one_landed_state_that_says_landing_is_no_landing():
    lied = flying("line")
    lied.lies.once(("landed", LANDING))
    lied.phases.clear()
    lied.run(S)
    assert lied.phases == [P.FLYING]


def test_one_landed_state_in_the_air_lifts_nothing_off():
    """ArduPilot's own takeoff would end with the first set-point."""
    lied = Lied(ARDUPILOT)
    lied.take_off("inside")
    lied.until(lambda: lied.craft.armed)
    lied.lies.once(("landed", IN_AIR))
    lied.until_phase(P.LANDED)
    assert lied.status.waypoint == 3


# --- the planner: any lie at any moment -------------------------------------------------------------------------------


class Lawful(Lied):
    """Looks at the vehicle itself, at every message that is sent and at every moment."""

    def __init__(self, **how) -> None:
        self.landing, self._up_ns = False, None
        super().__init__(**how)
        send = self.channel.ours

        def watched(messages):
            messages = list(messages)
            for message in messages:
                disarms = message.get_type() == "COMMAND_LONG" and self._named(message) == ["disarm"]
                assert not (disarms and self.has_told_that_it_flies), "a flying vehicle is disarmed"
            send(messages)

        self.channel.ours = watched

    @property
    def has_told_that_it_flies(self) -> bool:
        """True from a moment after the lift-off on: what it says of the ground comes at 5 Hz."""
        return self.craft.airborne and self._up_ns is not None and self.t_ns - self._up_ns > 300 * MS

    def _see(self) -> None:
        super()._see()
        self._up_ns = (self._up_ns or self.t_ns) if self.craft.airborne else None
        if self.craft.airborne and self.craft.armed and self.heard_up:
            assert self.phase in IN_FLIGHT, f"the planner has left its flight: {self.status}"
        if self.landing and self.craft.armed:
            assert self.planner._landing, "the landing does not stand any more"

    @property
    def heard_up(self) -> bool:
        """True once the planner has heard that it is in the air."""
        return self.planner._flight.airborne


MODES = ["AUTO.MISSION", "AUTO.LOITER", "AUTO.LAND", "AUTO.RTL", "OFFBOARD", "POSCTL"]
LIES = st.one_of(
    st.tuples(st.just("armed"), st.booleans()),
    st.tuples(st.just("mode"), st.sampled_from(MODES)),
    st.tuples(st.just("current mode"), st.sampled_from(MODES)),
    st.tuples(st.just("status"), st.just(CRITICAL)),
    st.tuples(st.just("landed"), st.sampled_from([ON_GROUND, IN_AIR, CLIMBING, LANDING])),
)
SAID = st.lists(LIES, min_size=1, max_size=2, unique_by=lambda lie: lie[0])  # at once: one datagram
WHEN = st.integers(0, 220)  # tenths of a second from the takeoff on; the flight takes 20 s
ASKED = st.one_of(st.none(), st.integers(40, 150))  # when a landing is commanded
KINDS, MISSIONS = st.sampled_from([PX4, ARDUPILOT]), st.sampled_from(["line", "inside"])


@example("inside", PX4, [(70, [*DOWN])], None)
@example("line", ARDUPILOT, [(70, [*DOWN]), (100, [*DOWN])], None)
@example("line", PX4, [(80, [("mode", "POSCTL")])], 77)
@example("inside", ARDUPILOT, [(80, [("mode", "AUTO.LAND")])], 77)
@example("inside", ARDUPILOT, [(15, [("landed", IN_AIR)])], None)
@example("line", PX4, [(24, [("mode", "POSCTL")]), (34, [("armed", False)])], None)
@example("line", PX4, [(0, [("status", CRITICAL)])], 40)  # as it lifts off
@example("inside", PX4, [(0, [("status", CRITICAL)])], 49)  # likewise
@pytest.mark.long
@settings(max_examples=25, deadline=None)
@given(MISSIONS, KINDS, st.lists(st.tuples(WHEN, SAID), min_size=1, max_size=3), ASKED)
def test_whatever_one_message_says_at_any_moment_of_a_flight(mission, kind, lies, asked):
    lied = Lawful(kind=kind)
    lied.take_off(mission)
    began_ns = lied.t_ns
    happens = sorted([(tenths, 0, said) for tenths, said in lies] + ([(asked, 1, [])] if asked else []))
    for tenths, lands, said in happens:
        lied.run(max(0, began_ns + tenths * S // 10 - lied.t_ns))
        if lands:
            lied.craft.flags.ignores = ("AUTO.LAND",)  # for half a second: a lie in between may not end it
            if lied.command(A.LAND) == "":
                lied.landing = True
            lied.run(S // 2)
            lied.craft.flags.ignores = ()
        lied.lies.once(*said)
    lied.until(lambda: not lied.craft.armed and lied.phase not in IN_FLIGHT, 60 * S)
    assert (lied.craft.height_m, lied.craft.airborne) == (0.0, False)
    flown = lied.phase is P.LANDED and lied.status.waypoint == 3
    on_its_way = all(tenths > 40 for tenths, _ in lies)
    assert flown or lied.landing or not on_its_way, lied.status


# --- the autopilot node -----------------------------------------------------------------------------------------------


class LiedClient(ClientBench):
    """The autopilot node's client, which hears lies, in flight."""

    def __init__(self, up_m=5.0) -> None:
        self._ground_ns = 0
        super().__init__()
        self.fly(up_m)
        self.lies = Liar(self.client)

    def step(self) -> None:
        """Look at the vehicle itself at every moment; that it has lifted off it says within 0.2 s."""
        disarmed = len(self.commands(ARM))
        super().step()
        self._ground_ns = self._ground_ns if self.far.craft.airborne else self.t_ns
        new = len(self.commands(ARM)) > disarmed
        assert not (new and self.t_ns - self._ground_ns > 220 * MS), "a flying vehicle is disarmed"

    def forge(self, *lies) -> None:
        """Have the client get one datagram that nobody sent."""
        self.transmit(self.lies.datagram(self.t_ns, *lies))

    @property
    def mode(self) -> str:
        """In which it really is."""
        return self.far.craft.mode


ANY_ONE = pytest.mark.parametrize(
    "lies",
    [DOWN, DOWN[:1], DOWN[1:], [("mode", "POSCTL")], [("mode", "AUTO.RTL")], [("mode", "AUTO.LAND")]],
    ids=["down", "disarmed", "on ground", "pilot", "return", "lands"],
)


@ANY_ONE
@pytest.mark.slow_rows
def test_a_landing_of_the_autopilot_node_stands_whatever_one_message_says(lies):
    lied = LiedClient(20.0).advance(1.0)
    lied.far.craft.flags.ignores = ("AUTO.LAND",)
    lied.ask(lied.client.land)
    lied.advance(1.5)
    lied.forge(*lies)
    lied.advance(0.6)
    assert lied.client.commanding == "AUTO.LAND"
    lied.far.craft.flags.ignores = ()
    lied.until(lambda: lied.mode == "AUTO.LAND", 1.5)
    lied.until(lambda: lied.client.land_reply().final, 1.5)
    assert lied.client.land_reply() == Reply(accepted=True, message="the vehicle is in its landing mode", final=True)
    lied.until(lambda: not lied.far.craft.armed)
    lied.until(lambda: lied.client.commanding == "", 2.5)


@ANY_ONE
def test_a_landing_that_the_autopilot_node_is_asked_for_right_after_a_lie_is_sent(lies):
    lied = LiedClient().advance(1.0)
    lied.forge(*lies)
    answer = lied.ask(lied.client.land)
    if answer.message.startswith("the pilot has control"):
        lied.advance(0.5)  # refused at his first sign, and asked for again as the engine does
        answer = lied.ask(lied.client.land)
    assert answer == Reply(accepted=True, message="landing: commanded, not shown yet", final=False)
    lied.until(lambda: lied.mode == "AUTO.LAND", 0.7)
    lied.until(lambda: lied.client.land_reply().final, 1.2)
    assert lied.client.land_reply().accepted


@ANY_ONE
def test_an_autopilot_node_that_is_told_to_end_right_after_a_lie_lands(lies):
    leaves_and_lands(lies)


def test_one_heartbeat_that_says_failsafe_leaves_the_landing_of_a_node_that_ends_to_nobody():
    leaves_and_lands([("status", CRITICAL)])


def leaves_and_lands(lies):
    lied = LiedClient().advance(1.0)
    lied.forge(*lies)
    assert lied.vehicle.in_flight(lied.t_ns)
    assert not lied.ask(lied.client.leave).final
    lied.until(lambda: lied.mode == "AUTO.LAND", 1.2)


def test_who_asks_for_a_landing_of_a_vehicle_that_is_down_is_told_so_once_messages_agree():
    lied = LiedClient().advance(1.0)
    lied.ask(lied.client.land)
    lied.until(lambda: not lied.far.craft.armed)
    lied.advance(2.5).sent.clear()
    assert lied.ask(lied.client.land).message == "the vehicle is on the ground and disarmed"
    assert lied.commands(SET_MODE) == []


def test_the_autopilot_node_disarms_nothing_on_one_on_ground():
    lied = LiedClient().advance(1.0)
    lied.lies.once(("landed", ON_GROUND))
    lied.until(lambda: lied.vehicle.landed(lied.t_ns).name == "ON_GROUND", 0.5)
    assert lied.ask(lied.client.disarm) == Reply(
        accepted=False, message="ON_GROUND must be said for 0.5 s before it is believed", final=True
    )


def test_a_disarming_that_is_under_way_is_not_sent_into_the_air_by_one_on_ground():
    """On the ground, armed, told to disarm, which it refuses; then somebody takes off."""
    lied = LiedClient().advance(1.0)
    lied.far.craft.flags.does_not_disarm = True
    lied.ask(lied.client.land)
    lied.until(lambda: lied.vehicle.landed(lied.t_ns).name == "ON_GROUND").advance(1.0)
    lied.ask(lied.client.disarm)
    lied.far.craft.climb_to(5.0)
    lied.until(lambda: lied.far.craft.airborne, 5.0)
    lied.ask(lied.client.disarm)
    lied.advance(0.3)
    sent = lied.commands(ARM)
    for _ in range(4):
        lied.lies.once(("landed", ON_GROUND))
        lied.advance(0.3)
    assert lied.commands(ARM) == sent


def taking_off(mission, kind):
    """Return a takeoff from a mode of the sticks, just when it arms: the vehicle has shown a mode of ours."""
    lied = Lied(kind)
    lied.craft.command_mode("POSCTL")
    lied.run(2 * S)
    lied.take_off(mission)
    lied.until(lambda: "arm" in lied.since(0))
    return lied


@EACH
@BOTH
def test_a_heartbeat_of_before_the_takeoff_that_is_overtaken_on_its_way_ends_no_takeoff(mission, kind):
    lied = taking_off(mission, kind)
    lied.run(100 * MS)
    sent_ns = lied.t_ns
    lied.forge(("mode", "POSCTL"), ("armed", False))
    lied.run(50 * MS)
    assert lied.since(sent_ns) == []
    lied.until_phase(P.LANDED)
    assert (lied.status.waypoint, lied.status.message) == (3, "")


@EACH
@BOTH
@pytest.mark.parametrize("late_ms", [0, 400])
def test_a_pilot_who_takes_the_vehicle_back_during_the_takeoff_has_it_also_just_after_our_mode(mission, kind, late_ms):
    lied = taking_off(mission, kind)
    lied.craft.flags.not_ready = {"rc": "it does not arm"}
    lied.run(late_ms * MS)
    lied.craft.command_mode("POSCTL")
    taken_ns = lied.t_ns
    lied.run(4 * S)
    ended = "takeoff ended: the vehicle went to POSCTL by itself"
    said = "the pilot has control (mode POSCTL)" if lied.craft.armed else ended
    assert (lied.craft.mode, lied.status.message) == ("POSCTL", said)
    assert not {"AUTO.LOITER", "AUTO.MISSION", "OFFBOARD", "start", "takeoff"} & set(lied.since(taken_ns))


def test_one_on_ground_in_the_air_moves_the_place_of_the_takeoff_nowhere():
    """Heights above it, and distances from it, are limits of the flight."""
    lied = LiedClient().advance(1.0)
    before = lied.vehicle.status(lied.t_ns)
    lied.forge(("landed", ON_GROUND))
    lied.advance(0.5)
    after = lied.vehicle.status(lied.t_ns)
    assert after.height_m == pytest.approx(before.height_m, abs=0.5)
    assert after.height_m > 4.0


@pytest.mark.parametrize("after_ms", range(0, 1000, 150))
@pytest.mark.parametrize(
    "lie", [("mode", "POSCTL"), ("mode", "AUTO.RTL"), ("status", CRITICAL)], ids=["pilot", "return", "failsafe"]
)
@pytest.mark.slow_rows
def test_a_takeover_that_one_heartbeat_says_is_over_before_the_engine_believes_it(lie, after_ms):
    """Half a second of statuses can come of one heartbeat of a PX4, which beats at 1 Hz: another one is asked for."""
    lied = LiedClient().advance(1.0 + after_ms / 1000)
    lied.forge(lie)
    status, began_ns = lied.vehicle.status(lied.t_ns), lied.t_ns
    assert status.pilot_in_control or status.failsafe
    while status.pilot_in_control or status.failsafe or status.mode != lied.mode:
        lied.step()
        status = lied.vehicle.status(lied.t_ns)
    assert lied.t_ns - began_ns < 250 * MS  # pilot_confirm_s is 0.3


CLIENT_LIES = st.lists(st.tuples(st.integers(0, 60), SAID), min_size=1, max_size=3)


@example([(15, [*DOWN])], 0)
@example([(20, [("mode", "AUTO.LAND")])], 15)
@example([(26, [("status", CRITICAL), ("current mode", "AUTO.RTL")])], 31)
@pytest.mark.long
@pytest.mark.night
@settings(max_examples=20, deadline=None)
@given(CLIENT_LIES, st.integers(0, 40))
def test_whatever_one_message_says_at_any_moment_of_a_landing_by_the_autopilot_node(lies, asked):
    lied = LiedClient(20.0)
    began_ns = lied.t_ns
    happens = sorted([(tenths, 0, said) for tenths, said in lies] + [(asked, 1, [])])
    lands = False
    for tenths, landing, said in happens:
        while lied.t_ns < began_ns + tenths * S // 10:
            lied.step()
            standing = lied.client.commanding if lands else "AUTO.LAND"
            assert standing == "AUTO.LAND", "the landing does not stand any more"
            assert lied.vehicle.in_flight(lied.t_ns)
        if landing:
            lied.far.craft.flags.ignores = ("AUTO.LAND",)  # for half a second: a lie in between may not end it
            while not lied.ask(lied.client.land).accepted:  # refused at a pilot's first sign: the engine asks again
                lied.advance(0.5)
                assert lied.t_ns < began_ns + asked * S // 10 + 2 * S, "a lie refuses the landing for good"
            lands = True
            lied.advance(0.5)
            lied.far.craft.flags.ignores = ()
        lied.lies.once(*said)
    lied.until(lambda: lied.mode == "AUTO.LAND", 2.5)
    lied.until(lambda: not lied.far.craft.armed)
    lied.until(lambda: lied.client.commanding == "", 2.5)
    assert not lied.vehicle.in_flight(lied.t_ns)
