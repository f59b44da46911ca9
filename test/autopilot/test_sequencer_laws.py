"""Whatever is asked of the planner, whatever the vehicle does and the link loses: what must never happen, does not."""

from __future__ import annotations

from random import Random

import pytest
from flying import ARDUPILOT, MS, PX4, Flying, S, stand_still
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mission_channel import good

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.autopilot.planner.mission_upload import Dialect
from amaze_autonomy.autopilot.vehicle.agreement import DRAIN_NS
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase, VehicleLanded

P, A = MissionPhase, MissionAction
SET_MODE, ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
STREAM_GAP_NS, FRESH_NS, SILENT_NS = 200 * MS, 700 * MS, 3 * S


MOTION = (SET_MODE, ARM, mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_NAV_TAKEOFF)
LANDINGS = {"AUTO.LAND", "disarm"}
UPLOADS = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_SET_CURRENT")


class Watched(Flying):
    """Looks at every message that is sent, and at every state."""

    def __init__(self, **how) -> None:
        self.setpoint_ns = 0
        self.landing = False  # a landing was taken, and nothing was loaded since
        self.unasked = False  # the vehicle was not heard for longer than the limit, and nothing was asked since
        self.armings = 0
        self.woken_ns = 0  # when the planner's process went on after it had stood still
        super().__init__(**how)
        send = self.channel.ours

        def watched(messages):
            messages = list(messages)
            for message in messages:
                self.look(message)
            send(messages)

        self.channel.ours = watched

    def look(self, message) -> None:
        watch, kind = self.planner.watch, message.get_type()
        if kind == "SET_POSITION_TARGET_LOCAL_NED":
            self.setpoint_ns = self.t_ns
            assert (message.target_system, message.target_component) == (1, 1)
        assert not self.landing or kind not in UPLOADS, f"{kind} after a landing was taken"
        if kind != "COMMAND_LONG" or message.command not in MOTION:
            return
        assert not (watch.armed and watch.pilot), "a vehicle that a pilot flies is commanded"
        meant = self.meant(message)
        anew = (watch.mode_ns or 0) >= self.woken_ns
        assert anew or meant in LANDINGS, f"{meant} before the vehicle was heard again"
        assert not self.landing or meant in LANDINGS, f"{meant} after a landing was taken"
        assert not self.unasked or meant in LANDINGS, f"{meant} after a silence, and nobody asked for it"
        fresh = watch.landed_ns is not None and self.t_ns - watch.landed_ns <= FRESH_NS
        grounded = fresh and watch.landed is VehicleLanded.ON_GROUND
        assert meant != "disarm" or grounded, "disarmed on a landed state that is old or another one"
        if message.command == ARM:
            self.armings += message.param1 == 1.0
            assert message.param2 == 0.0, "arming or disarming by force"
            down = watch.landed not in (VehicleLanded.IN_AIR, VehicleLanded.LANDING, VehicleLanded.TAKING_OFF)
            assert message.param1 == 1.0 or down, "disarmed in flight"

    def meant(self, message) -> str:
        """Return what a command means."""
        if message.command == SET_MODE:
            land = self.planner.watch.numbers("AUTO.LAND")
            return "AUTO.LAND" if (message.param2, message.param3) == land else "another mode"
        return ("disarm", "arm")[message.param1 == 1.0] if message.command == ARM else "start"

    def command(self, action, session="s1") -> str:
        self.note()
        before, self.unasked, landing = self.unasked, False, self.landing
        self.landing = landing or action in (A.LAND, A.ABORT)  # what is sent at once is looked at as well
        problem = super().command(action, session)
        if problem:
            self.unasked, self.landing = before, landing
        return problem

    def note(self) -> None:
        if not self.planner.watch.known(self.t_ns, SILENT_NS):
            self.unasked = not self.landing

    def _see(self) -> None:
        super()._see()
        self.note()
        watch, status = self.planner.watch, self.status
        if status.phase is P.HOLDING and watch.armed:
            holds = watch.mode in ("AUTO.LOITER", "OFFBOARD", "AUTO.LAND")  # the last: of somebody else
            assert holds or "by itself" in status.message or watch.pilot
        if status.phase is P.LOADED:
            assert not status.waypoint
        assert 0 <= status.waypoint <= status.waypoints
        streamed = self.setpoint_ns and self.t_ns - self.setpoint_ns <= STREAM_GAP_NS
        streamed = streamed or self.t_ns - self.woken_ns <= STREAM_GAP_NS
        begun = self.setpoint_ns or self.planner._means.watch.dialect is Dialect.PX4  # ArduPilot's: once it is up
        up = watch.armed and self.craft.armed  # a PX4 that disarms shows the intended mode before it says so
        if watch.mode == "OFFBOARD" and up and self.planner._flight.guidance is not None and begun:
            assert streamed, "the stream has stopped in flight"


EVENTS = st.one_of(
    st.tuples(st.just("command"), st.sampled_from(sorted(A, key=lambda each: each.value))),
    st.tuples(st.just("load"), st.sampled_from(["line", "inside", "both"])),
    st.tuples(st.just("pilot"), st.sampled_from(["POSCTL", "MANUAL", "AUTO.RTL"])),
    st.tuples(st.just("failsafe"), st.sampled_from(["AUTO.RTL", "AUTO.LAND", "AUTO.LOITER"])),
    st.tuples(st.just("mode"), st.sampled_from(["AUTO.LAND", "AUTO.LOITER"])),
    st.tuples(st.just("ignores"), st.sampled_from(["AUTO.LAND", "AUTO.LOITER", "AUTO.MISSION", "OFFBOARD"])),
    st.tuples(st.just("obeys"), st.none()),
    st.tuples(st.just("refuses to arm"), st.booleans()),
    st.tuples(st.just("cut"), st.sampled_from([500, 2000, 5000])),
    st.tuples(st.just("loses"), st.sampled_from([0, 20, 60])),
    st.tuples(st.just("slow"), st.sampled_from([5, 300, 900])),
    st.tuples(st.just("other"), st.sampled_from(["AUTO.LAND", "DISARM", ""])),
    st.tuples(st.just("deaf to the ground"), st.booleans()),
    st.tuples(st.just("shutdown"), st.none()),
    st.tuples(st.just("stands still"), st.sampled_from([600, 1500, 4000])),
)
PLANS = st.lists(st.tuples(st.sampled_from([0, 50, 300, 1000, 4000]), EVENTS), max_size=12)


def load(flying, mission) -> None:
    loading, messages = flying.planner.load(flying.t_ns, LoadRequest("s1", mission, 0, 0))
    if not loading.refused:  # the next flight is asked for
        assert not flying.craft.armed or not flying.landing, "loaded into a vehicle that is being landed"
        flying.landing = flying.unasked = False
    flying.channel.ours(messages)


def fail_safe(flying, mode) -> None:
    if flying.craft.armed:
        flying.craft.enter_failsafe(mode)


def cut(flying, for_ms) -> None:
    good, flying.channel.fate = flying.channel.fate, lambda: ()
    flying.run(for_ms * MS)
    flying.channel.fate = good


def shut_down(flying, _) -> None:
    lands, messages = flying.planner.shutdown(flying.t_ns)
    flying.landing = flying.landing or lands
    flying.channel.ours(messages)


def lose(flying, percent) -> None:
    random = Random(percent)
    flying.channel.fate = lambda: () if random.random() * 100 < percent else (random.randrange(1, 50) * MS,)


def other(flying, what) -> None:
    messages = flying.planner.other_commands(flying.t_ns, what)
    flying.landing = flying.landing or bool(messages)
    flying.channel.ours(messages)


def deaf(flying, so) -> None:
    """Have the planner hear the landed state of the vehicle no more."""
    watch = flying.planner.watch
    watch.__dict__.pop("take", None)
    take = watch.take
    if so:
        watch.take = (
            lambda t_ns, message, **_: None if message.get_type() == "EXTENDED_SYS_STATE" else take(t_ns, message)
        )


def stand(flying, for_ms) -> None:
    flying.woken_ns = flying.t_ns + for_ms * MS + DRAIN_NS  # before it reads
    stand_still(flying, for_ms * MS)
    flying.note()


HAPPENS = {
    "stands still": stand,
    "loses": lose,
    "slow": lambda flying, ms: setattr(flying.channel, "fate", lambda: (ms * MS,)),
    "other": other,
    "deaf to the ground": deaf,
    "mode": lambda flying, mode: flying.craft.command_mode(mode),
    "command": Flying.command,
    "load": load,
    "pilot": lambda flying, mode: flying.craft.pilot_takes_over(mode, 5 * S),
    "failsafe": fail_safe,
    "ignores": lambda flying, mode: setattr(flying.craft.flags, "ignores", (mode,)),
    "obeys": lambda flying, _: setattr(flying.craft.flags, "ignores", ()),
    "refuses to arm": lambda flying, so: setattr(flying.craft.flags, "not_ready", {"rc": "no RC"} if so else {}),
    "cut": cut,
    "shutdown": shut_down,
}


def calm_down(flying) -> None:
    """End as the engine does: nothing is broken any more, and LAND is asked for until it is on the ground."""
    flying.craft.flags.ignores, flying.craft.flags.not_ready = (), {}
    flying.channel.fate = good
    deaf(flying, so=False)
    for _ in range(60):
        if not flying.craft.armed and flying.phase not in (P.TAKING_OFF, P.FLYING, P.HOLDING, P.LANDING):
            return
        flying.command(A.LAND)
        flying.run(2 * S)
    raise AssertionError(f"still up: {flying.status}, {flying.craft.mode}, armed {flying.craft.armed}")


@example("line", PX4, [(4000, ("ignores", "AUTO.LAND")), (300, ("command", A.LAND)), (0, ("command", A.HOLD))])
@example("line", ARDUPILOT, [(4000, ("ignores", "AUTO.LOITER")), (0, ("command", A.HOLD)), (50, ("cut", 5000))])
@example("inside", PX4, [(50, ("refuses to arm", True)), (1000, ("cut", 5000)), (300, ("command", A.LAND))])
@example("line", PX4, [(0, ("command", A.ABORT)), (4000, ("load", "line")), (50, ("command", A.LAND))])
@example("line", PX4, [(50, ("deaf to the ground", True)), (1000, ("command", A.ABORT))])
@example("line", PX4, [(4000, ("pilot", "AUTO.RTL")), (1000, ("shutdown", None)), (300, ("command", A.LAND))])
@example("line", PX4, [(4000, ("ignores", "AUTO.LOITER")), (0, ("command", A.HOLD)), (50, ("stands still", 1500))])
@example("inside", ARDUPILOT, [(1000, ("stands still", 600)), (4000, ("command", A.LAND)), (0, ("stands still", 4000))])
@settings(max_examples=30, deadline=None)
@given(st.sampled_from(["line", "inside"]), st.sampled_from([PX4, ARDUPILOT]), PLANS)
def test_no_order_of_events_leads_to_what_must_not_be(mission, autopilot, events):
    flying = Watched(kind=autopilot)
    assert flying.load(mission).accepted
    flying.command(A.TAKEOFF)
    for delay_ms, (kind, what) in events:
        flying.run(delay_ms * MS)
        HAPPENS[kind](flying, what)
    calm_down(flying)
    assert flying.craft.height_m == 0.0


@pytest.mark.parametrize("mission", ["line", "inside"])
@pytest.mark.parametrize("seed", range(3))
def test_over_a_bad_link_nothing_is_done_twice(mission, seed):
    random = Random(seed)
    flying = Watched(fate=lambda: () if random.random() < 0.05 else (random.randrange(1, 50) * MS,))
    armed = []
    set_armed = flying.craft._set_armed
    flying.craft._set_armed = lambda: (armed.append(flying.t_ns), set_armed())
    flying.take_off(mission)
    flying.until_phase(P.LANDED)
    assert (len(armed), flying.status.waypoint) == (1, 3)


@example("line", PX4, 300, 800, 1300, 0)
@example("inside", ARDUPILOT, 5, 0, 3000, 0)
@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from(["line", "inside"]),
    st.sampled_from([PX4, ARDUPILOT]),
    st.integers(1, 400),
    st.integers(0, 4000),
    st.integers(0, 3000),
    st.sampled_from([0, 5, 15]),
)
def test_told_to_end_at_any_moment_of_a_takeoff_it_leaves_no_vehicle_armed(
    mission, autopilot, slow_ms, told_ms, abort_ms, lost_percent
):
    """It may be in the air by then: there it lands."""
    random = Random(slow_ms)
    flying = Watched(kind=autopilot)
    assert flying.load(mission).accepted
    flying.channel.fate = lambda: () if random.random() * 100 < lost_percent else (slow_ms * MS,)
    flying.command(A.TAKEOFF)
    if abort_ms < told_ms:
        flying.run(abort_ms * MS)
        flying.command(A.ABORT)
    flying.run(max(0, told_ms - abort_ms if abort_ms < told_ms else told_ms) * MS)
    shut_down(flying, None)
    flying.until(lambda: flying.planner.landing_shown, 3 * S, must=False)  # exit_limit_s
    flying.planner.receive = flying.planner.wake = lambda *_, **__: []  # its process has ended
    flying.run(S)
    flying.until(lambda: not flying.craft.armed or flying.craft.mode == "AUTO.LAND", S)
