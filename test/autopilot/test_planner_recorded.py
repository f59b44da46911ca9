"""What the planner would have believed of a real PX4: recordings of v1.16.1, message by message."""

from __future__ import annotations

from recorded import S, recording

from amaze_autonomy.autopilot.link.framing import read_tlog
from amaze_autonomy.autopilot.link.peers import Identity, Peers
from amaze_autonomy.autopilot.link.wire import decode
from amaze_autonomy.autopilot.planner.flight_progress import FlightRecord
from amaze_autonomy.autopilot.planner.mission_upload import Dialect
from amaze_autonomy.autopilot.planner.mission_vehicle import VehicleWatch
from amaze_autonomy.autopilot.planner.procedure import Means, Procedure, Progress, steps_of
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase
from amaze_autonomy.missions import Controller, PlannerSpec

P = MissionPhase


class Recorded:
    """A recording: (ns since its beginning, message) of the vehicle, through a watch."""

    def __init__(self, name: str) -> None:
        self.watch = VehicleWatch()
        self._peers = Peers(Identity(245, 191, 1))
        self._frames, _ = read_tlog(recording(name))

    def __iter__(self):
        start_ns = None
        for t_ns, frame in self._frames:
            start_ns = start_ns or t_ns
            message = decode(frame)
            if self._peers.take(t_ns, message):
                self.watch.take(t_ns - start_ns, message)
                yield t_ns - start_ns, message


def test_a_flight_by_a_mission_has_these_phases_and_counts_its_waypoints():
    recorded = Recorded("px4_normal_mission.tlog")
    record, phase, seen = FlightRecord(recorded.watch, 3), P.TAKING_OFF, []
    for t_ns, _ in recorded:
        record.look()
        if record.armed and recorded.watch.armed:
            phase = record.phase(phase)
        elif record.armed and record.seems_down and record.is_counted(t_ns, asked=False):
            phase = P.LANDED if recorded.watch.ground.is_down(t_ns, 3 * S) else phase
        now = (phase, record.reached)
        if not seen or seen[-1][1] != now:
            seen.append((round(t_ns / S, 1), now))
    assert seen == [
        (0.0, (P.TAKING_OFF, 0)),
        (13.2, (P.FLYING, 0)),
        (22.7, (P.FLYING, 1)),
        (32.3, (P.FLYING, 2)),
        (43.6, (P.FLYING, 3)),
        (44.3, (P.LANDING, 3)),
        (68.8, (P.LANDED, 3)),  # two heartbeats that say disarmed: 66.8 and, one was not sent, 68.8
    ]


def enter_offboard(recorded, begin_s: float, end_s: float):
    """Have the change to OFFBOARD under way in a part of a recording; return [(s, progress)] and the procedure."""
    spec = PlannerSpec()
    means = Means(recorded.watch, spec.setpoint_lead_ns, stream_ns=0)
    procedure, said = None, []
    for t_ns, _ in recorded:
        if procedure is None and t_ns >= begin_s * S:
            steps = steps_of(Controller.OFFBOARD, MissionAction.RESUME, Dialect.PX4)
            procedure = Procedure(MissionAction.RESUME, steps, means, spec, t_ns)
        if procedure is not None and t_ns <= end_s * S:
            procedure.wake(t_ns)
            if not said or said[-1][1] is not procedure.progress:
                said.append((round(t_ns / S, 1), procedure.progress))
    return said, procedure


def test_two_acknowledgements_for_one_change_of_mode_change_nothing():
    """ACCEPTED, then TEMPORARILY_REJECTED at 11.69 s, and the mode stays: the first is not believed."""
    said, procedure = enter_offboard(Recorded("px4_offboard.tlog"), 11.6, 15.3)
    assert [progress for _, progress in said] == [Progress.RUNNING]
    assert procedure.reason == ""


def test_a_change_that_is_refused_has_failed_at_its_limit_with_the_reason():
    recorded = Recorded("px4_offboard.tlog")
    said, procedure = enter_offboard(recorded, 11.2, 15.35)
    assert [progress for _, progress in said] == [Progress.RUNNING, Progress.FAILED]
    assert procedure.reason == "change to OFFBOARD: not shown within 4 s (TEMPORARILY_REJECTED)"


def test_a_change_that_is_shown_by_the_heartbeat_is_done():
    said, _ = enter_offboard(Recorded("px4_offboard.tlog"), 15.3, 20.0)
    assert said == [(15.3, Progress.RUNNING), (15.8, Progress.DONE)]


def test_a_failsafe_that_takes_over_in_the_middle_of_a_command_keeps_the_vehicle():
    """At 30.0 s PX4 leaves OFFBOARD for POSCTL by itself, CRITICAL: no pilot, and not ours."""
    recorded = Recorded("px4_offboard.tlog")
    said, procedure = enter_offboard(recorded, 29.9, 33.0)
    assert said == [(29.9, Progress.RUNNING), (31.0, Progress.TAKEN)]  # two heartbeats; nothing is sent from 30.0 on
    assert procedure.reason == "resume ended: the vehicle went to POSCTL by itself"
    assert not recorded.watch.pilot


def test_after_the_landing_the_mode_is_the_last_one_that_somebody_wanted():
    recorded = Recorded("px4_offboard.tlog")
    record, ends = FlightRecord(recorded.watch, 3), []
    for t_ns, _ in recorded:
        record.look()
        watch = recorded.watch
        if record.airborne and watch.armed is False and watch.on_ground(t_ns, 3 * S):
            ends.append((round(t_ns / S, 1), watch.mode, record.reached))
    assert ends[0] == (47.3, "OFFBOARD", 0)


def test_positions_are_good_only_while_the_estimator_stands_by_them():
    recorded = Recorded("px4_gps_loss_param.tlog")
    seen = []
    for t_ns, _ in recorded:
        watch = recorded.watch
        fresh = watch.place is not None and t_ns - watch.place_ns < S
        now = (fresh, watch.somewhere(t_ns, S) is not None, watch.local(t_ns, S) is not None)
        if not seen or seen[-1][1] != now:
            seen.append((round(t_ns / S, 1), now))
    lost = [each for each in seen if each[0] > 20.0]
    assert lost[0][1] == (True, False, False)
    assert 27.0 <= lost[0][0] <= 27.5  # the flags are lost at 27.2 s; the messages stay fresh
