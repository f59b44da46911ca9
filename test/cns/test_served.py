"""Our watchdog, checks and recorder in the places of the CNS nodes: what its engine is answered, and told."""

from __future__ import annotations

import math
from itertools import count

import pytest
from stand_ins import DEFECT, ERROR, NOMINAL, STARTING, UNDEF, namespace

from amaze_autonomy.cns.peers import Publish
from amaze_autonomy.cns.served import (
    Entity,
    Response,
    ServedCheck,
    ServedLanding,
    ServedRecorder,
    ServedWatchdog,
)
from amaze_autonomy.engine.commands import RunCheck, StartRecording, StopRecording
from amaze_autonomy.engine.events import (
    Check,
    CheckName,
    CheckReply,
    ComponentStatus,
    Landed,
    LandedStatus,
    Outcome,
    RecordingPhase,
    RecordingStatus,
    Reply,
    Verdict,
    WatchdogAction,
    WatchdogInfo,
)
from amaze_autonomy.engine.rules import Code, Limits, Rules, Severity
from amaze_autonomy.monitoring.specs import ComponentSpec, TopicSpec

S = 1_000_000_000
P = RecordingPhase


def sent(served, kind):
    """Return what is in the outbox, which becomes empty, of one kind."""
    outbox, served.outbox = served.outbox, []
    return [each for each in outbox if isinstance(each, kind)]


# --- watchdog ---------------------------------------------------------------------------------------------------------

LRF = ComponentSpec("lrf", severity=Severity.HIGH, topics=(TopicSpec("/lrf/range", 20.0),))
UWB = ComponentSpec("uwb_tag_1", severity=Severity.HIGH, node="/uwb")
ENTITIES = {"lrf": Entity.of(LRF), "uwb_tag_1": Entity.of(UWB, "UWB-Tag 1")}
GOOD = {"lrf": Code.NOMINAL, "uwb_tag_1": Code.NOMINAL}


@pytest.fixture
def watchdog():
    return ServedWatchdog(count(1), CheckName.WATCHDOG, ENTITIES, 3 * S)


def info(t_s, **codes):
    components = tuple(ComponentStatus(name, code, reason="why") for name, code in {**GOOD, **codes}.items())
    return WatchdogInfo(t_ns=round(t_s * S), sequence=1, changed=(), components=components)


def action(t_s, counter, code=Code.NOMINAL, publisher="/watchdog"):
    t_ns = round(t_s * S)
    return WatchdogAction(t_ns=t_ns, sequence=counter, loop_counter=counter, code=code, publisher=publisher)


def tell(watchdog, *events):
    for event in events:
        watchdog.told(event.t_ns, event)


def start(watchdog, t_s=0.0, startup_s=10.0):
    watchdog.asked(round(t_s * S), 5, namespace({"startup_time": startup_s}))
    (command,) = sent(watchdog, RunCheck)
    return command


def answer(watchdog, command, t_s, *, ok=True, outcome=Outcome.ACCEPTED, checks=(), **codes):
    t_ns = round(t_s * S)
    watchdog.replied(
        t_ns,
        CheckReply(
            t_ns=t_ns,
            command_id=command.id,
            check=CheckName.WATCHDOG,
            outcome=outcome,
            ok=ok,
            checks=checks,
            components=info(t_s, **codes).components if outcome is Outcome.ACCEPTED else (),
            message="" if outcome is Outcome.ACCEPTED else "no such service",
        ),
    )
    ((number, fields),) = sent(watchdog, Response)
    assert (number, fields["entity_ids"]) == (5, [])
    return fields["successful"], fields["status"]["status"]


def statuses(log):
    """Return what a log says: of the changes, and of all."""
    data = log.fields["data"]
    return [{each["entity"]: each["status"] for each in data[part]} for part in ("changes", "current")]


def test_the_start_call_starts_ours_for_its_startup_time(watchdog):
    command = start(watchdog)
    assert (command.check, command.startup_time_ns, command.limit_ns) == (CheckName.WATCHDOG, 10 * S, 13 * S)


@pytest.mark.parametrize("given, taken", [(-1.0, 0), (math.nan, 0), (math.inf, 0), (1e9, 600 * S)])
def test_a_startup_time_that_is_none_is_none(watchdog, given, taken):
    assert start(watchdog, startup_s=given).startup_time_ns == taken


@pytest.mark.parametrize(
    "t_s, codes, expected",
    [
        (1.0, {}, (True, NOMINAL)),
        (1.0, {"lrf": Code.NON_CRITICAL}, (False, STARTING)),  # in its start-up time
        (10.0, {"lrf": Code.NON_CRITICAL}, (True, DEFECT)),  # after it: off its rate
        (10.0, {"lrf": Code.INCONVENIENT}, (False, ERROR)),
        (10.0, {"lrf": Code.HOLD, "uwb_tag_1": Code.NON_CRITICAL}, (False, ERROR)),
        (10.0, {"lrf": Code.ABORT}, (False, ERROR)),
    ],
)
def test_the_start_call_is_answered_by_the_worst(watchdog, t_s, codes, expected):
    assert answer(watchdog, start(watchdog), t_s, ok=not codes, **codes) == expected


def test_a_watchdog_that_is_not_there_is_no_success(watchdog):
    assert answer(watchdog, start(watchdog), 1.0, outcome=Outcome.UNAVAILABLE) == (False, UNDEF)


def test_a_second_start_call_is_a_new_check(watchdog):
    first = start(watchdog)
    answer(watchdog, first, 2.0)
    second = start(watchdog, 20.0, startup_s=0.0)
    assert second.id != first.id
    assert answer(watchdog, second, 20.1, lrf=Code.NON_CRITICAL, ok=False) == (True, DEFECT)


def test_a_turn_of_our_loop_is_its_heartbeat_at_2_hz(watchdog):
    beats = []
    for step in range(50):  # 5 Hz for 10 s
        tell(watchdog, info(step / 5), action(step / 5, step))
        beats += [each for each in sent(watchdog, Publish) if each.key == "heartbeat"]
    assert len(beats) == pytest.approx(20, abs=4)
    assert {each.fields["status"]["status"] for each in beats} == {NOMINAL}


def test_a_loop_that_stands_still_does_not_beat(watchdog):
    tell(watchdog, action(0.0, 7))
    sent(watchdog, Publish)
    tell(watchdog, *(action(step / 5, 7) for step in range(1, 50)))
    assert sent(watchdog, Publish) == []
    tell(watchdog, action(10.0, 7, publisher="/watchdog_again"))
    assert [each.key for each in sent(watchdog, Publish)] == ["heartbeat"]


def test_the_heartbeat_says_the_worst_also_before_the_other_stream_does(watchdog):
    tell(watchdog, info(0.0, lrf=Code.NON_CRITICAL), action(0.0, 1))
    tell(watchdog, action(1.0, 2, Code.HOLD))
    beats = [each.fields["status"]["status"] for each in sent(watchdog, Publish) if each.key == "heartbeat"]
    assert beats == [DEFECT, ERROR]


def test_the_log_names_entities_and_says_what_changes_alone(watchdog):
    start(watchdog, startup_s=5.0)
    tell(watchdog, info(0.0, lrf=Code.NON_CRITICAL, uwb_tag_1=Code.NON_CRITICAL))
    tell(watchdog, info(1.0, lrf=Code.NON_CRITICAL), info(2.0, lrf=Code.NON_CRITICAL), info(3.0, lrf=Code.HOLD))
    assert [statuses(each) for each in sent(watchdog, Publish)] == [
        [{"lrf": STARTING, "UWB-Tag 1": STARTING}, {"lrf": STARTING, "UWB-Tag 1": STARTING}],
        [{"UWB-Tag 1": NOMINAL}, {"lrf": STARTING, "UWB-Tag 1": NOMINAL}],
        [{"lrf": ERROR}, {"lrf": ERROR, "UWB-Tag 1": NOMINAL}],
    ]
    (row,) = [each for each in watchdog.whole.fields["data"]["current"] if each["entity"] == "UWB-Tag 1"]
    assert (row["type"], row["name"], row["info"]) == (2, "/uwb", "why")  # its node


def test_what_starts_is_off_when_its_time_is_over_though_nothing_is_said(watchdog):
    start(watchdog, startup_s=5.0)
    tell(watchdog, info(1.0, lrf=Code.NON_CRITICAL))
    sent(watchdog, Publish)
    watchdog.step(5 * S)
    (log,) = sent(watchdog, Publish)
    assert statuses(log)[0] == {"lrf": DEFECT}


def test_who_listens_to_the_log_late_has_not_missed_the_first_changes(watchdog):
    assert watchdog.whole is None  # nothing is known
    tell(watchdog, info(0.0), info(1.0, lrf=Code.HOLD))
    both = {"lrf": ERROR, "UWB-Tag 1": NOMINAL}
    assert statuses(watchdog.whole) == [both, both]


# --- checks -----------------------------------------------------------------------------------------------------------


def ask_check(served, **reply):
    served.asked(0, 9, namespace({}))
    (command,) = sent(served, RunCheck)
    fixed = {"t_ns": 1, "command_id": command.id, "check": command.check, "outcome": Outcome.ACCEPTED}
    served.replied(1, CheckReply(**{**fixed, **reply}))
    ((number, fields),) = sent(served, Response)
    assert number == 9
    return command, (fields["success"], fields["message"])


ROWS = (
    Check("tilt", Verdict.FAIL, advice="stand it flat"),
    Check("imu", Verdict.UNKNOWN),
    Check("range", Verdict.PASS, advice="not this"),
)


@pytest.mark.parametrize(
    "make, check",
    [
        (lambda: ServedLanding(count(1), CheckName.ON_GROUND, 3 * S), CheckName.ON_GROUND),
        (lambda: ServedCheck(count(1), CheckName.STATE_ESTIMATION, 3 * S), CheckName.STATE_ESTIMATION),
    ],
)
def test_a_check_says_yes_or_no_with_the_rows_that_failed(make, check):
    command, answer = ask_check(make(), ok=True)
    assert (command.check, command.limit_ns, answer) == (check, 3 * S, (True, ""))
    assert ask_check(make(), ok=False, checks=ROWS)[1] == (False, "tilt: stand it flat; imu: unknown")
    gone = {"outcome": Outcome.TIMED_OUT, "message": "did not answer within the limit"}
    assert ask_check(make(), **gone)[1] == (False, "did not answer within the limit")


def test_a_level_of_our_landing_detection_is_one_message_for_each_event():
    landing = ServedLanding(count(1), CheckName.ON_GROUND, 3 * S)
    ground, air, unknown = Landed.ON_GROUND, Landed.AIRBORNE, Landed.UNKNOWN
    for landed in (unknown, ground, ground, air, air, unknown, air, unknown, ground, ground, air):
        landing.told(0, LandedStatus(t_ns=0, landed=landed))
    assert [(each.key, each.fields) for each in sent(landing, Publish)] == [
        ("is_takeoff", {"data": True}),
        ("is_landed", {"data": True}),
        ("is_takeoff", {"data": True}),
    ]


def test_a_first_level_is_no_event():
    landing = ServedLanding(count(1), CheckName.ON_GROUND, 3 * S)
    landing.told(0, LandedStatus(t_ns=0, landed=Landed.AIRBORNE))
    assert sent(landing, Publish) == []


# --- recorder ---------------------------------------------------------------------------------------------------------


class Recording:
    """One recorder as its engine sees it."""

    def __init__(self):
        self.served = ServedRecorder(count(1), Rules(), "begin")
        self.t_ns = 0

    def tell(self, phase, session="begin_1", message=""):
        self.served.told(self.t_ns, RecordingStatus(t_ns=self.t_ns, session_id=session, phase=phase, message=message))

    def ask(self, on, number=3):
        """Ask for it; return what our recorder is asked, if it is."""
        self.served.asked(self.t_ns, number, namespace({"data": on}))
        found = [each for each in self.served.outbox if isinstance(each, (StartRecording, StopRecording))]
        self.served.outbox = [each for each in self.served.outbox if each not in found]
        return found[0] if found else None

    def reply(self, command, problem=""):
        outcome = Outcome.REFUSED if problem else Outcome.ACCEPTED
        self.served.replied(self.t_ns, Reply(t_ns=0, command_id=command.id, outcome=outcome, message=problem))

    @property
    def said(self):
        return [(each.fields["success"], each.fields["message"]) for each in sent(self.served, Response)]


@pytest.fixture
def recording():
    recording = Recording()
    recording.tell(P.IDLE, "")
    return recording


@pytest.fixture
def running(recording):
    recording.reply(recording.ask(True))
    recording.tell(P.RECORDING)
    assert recording.said == [(True, "")]
    return recording


def test_a_start_is_a_success_when_it_records(recording):
    command = recording.ask(True)
    assert isinstance(command, StartRecording)
    assert command.session_id == "begin_1"
    recording.reply(command)
    recording.tell(P.IDLE, "")
    recording.tell(P.STARTING)
    assert recording.said == []
    recording.tell(P.RECORDING)
    assert recording.said == [(True, "")]


def test_a_start_that_shows_before_its_answer_is_one(recording):
    command = recording.ask(True)
    recording.tell(P.RECORDING)
    recording.reply(command)
    recording.served.step(1)
    assert recording.said == [(True, "")]


def test_a_start_that_does_not_begin_says_no(recording):
    recording.reply(recording.ask(True), "no space")
    assert recording.said == [(False, "no space")]
    recording.reply(recording.ask(True))
    recording.tell(P.FAILED, "begin_2", "second has not begun the session")
    assert recording.said == [(False, "second has not begun the session")]


def test_a_start_that_never_shows_says_no_when_its_time_is_over(recording):
    recording.reply(recording.ask(True))
    recording.served.step(Limits().recording_start_limit_ns - 1)
    assert recording.said == []
    recording.served.step(Limits().recording_start_limit_ns)
    assert recording.said == [(False, "the recorder has not done it within its limit")]


def test_a_recorder_that_says_nothing_is_none():
    recording = Recording()
    assert recording.ask(True) is recording.ask(False) is None
    assert recording.said == [(False, "our recorder says nothing")] * 2


def test_a_second_start_begins_no_other_recording(running):
    assert running.ask(True) is None
    assert running.said == [(True, "")]


def test_a_stop_is_a_success_when_the_recording_is_complete(running):
    command = running.ask(False)
    assert isinstance(command, StopRecording)
    assert command.session_id == "begin_1"
    running.reply(command)
    for phase in (P.RECORDING, P.STOPPING, P.TRANSFERRING, P.MERGING, P.VERIFYING):
        running.tell(phase)
        assert running.said == []
        assert running.ask(True) is None
        assert running.said == [(False, "the recorder is being stopped")]
    running.tell(P.COMPLETE, message="12 MB")
    assert running.said == [(True, "12 MB")]
    assert running.ask(False) is None
    assert running.said == [(False, "nothing is being recorded")]
    assert running.ask(True).session_id == "begin_2"


def test_a_stop_that_fails_says_what_is_missing_and_may_be_asked_again(running):
    running.reply(running.ask(False))
    running.tell(P.FAILED, message="second is not reached")
    assert running.said == [(False, "second is not reached")]
    running.reply(running.ask(False))
    running.served.step(1)  # what it said before is of no worth
    assert running.said == []
    running.tell(P.COMPLETE)
    assert running.said == [(True, "")]


@pytest.mark.parametrize("phase", [P.RECORDING, P.FAILED], ids=lambda phase: phase.name)
def test_what_a_process_before_this_one_began_is_stopped(phase):
    recording = Recording()
    recording.tell(phase, "before_1")
    assert recording.ask(False).session_id == "before_1"


def test_what_somebody_else_has_begun_meanwhile_is_what_is_recorded(running):
    running.tell(P.RECORDING, "other_1")
    assert running.ask(False).session_id == "other_1"


def test_what_others_record_is_not_taken_over_by_a_start():
    recording = Recording()
    recording.tell(P.RECORDING, "before_1")
    assert recording.ask(True) is None
    assert recording.said == [(True, "")]
