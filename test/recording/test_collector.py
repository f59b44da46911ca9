"""The collector: all platforms record, all parts come, one recording is made; what fails is named, a retry goes on."""

import json
from dataclasses import replace

import pytest
from recording_story import PHASE, Fleet, S

from amaze_autonomy.recording import Answer, Collector
from amaze_autonomy.recording.collector import Offset
from amaze_autonomy.recording.status import (
    Ask,
    Collect,
    CopyJournal,
    MeasureClock,
    PlatformStatus,
    Status,
    StopTransfer,
    Transfer,
    configured,
)

SUMMARY = {"problem": "", "location": "/rec/s1.bag", "message": "1 MB, nothing was lost", "verified": True}


def recording(**options):
    fleet = Fleet(**options)
    assert fleet.start() == Answer(accepted=True)
    fleet.go_on(0.5)
    assert fleet.collector.phase is PHASE.RECORDING
    return fleet


def transferring(**options):
    fleet = recording(**options)
    assert fleet.stop() == Answer(accepted=True)
    return fleet.go_on(0.5)


def merging(**options):
    fleet = transferring(**options)
    fetched(fleet)
    return fleet.go_on(0.2)


def fetched(fleet, problem="", number=None):
    """Let the fetch of second's part end that runs, or one that was begun before."""
    number = fleet.asked(Transfer)[-1].number if number is None else number
    fleet.collector.transfer_ended(fleet.now_ns, "second", number, problem)


def test_goes_all_the_way_from_idle_to_a_complete_recording():
    fleet = merging()
    fleet.collector.job_progress(fleet.now_ns, PHASE.VERIFYING, 0.5)
    fleet.go_on(0.1)
    fleet.collector.job_ended(fleet.now_ns, "", SUMMARY)
    fleet.go_on(1.0)
    assert fleet.phases == [
        PHASE.IDLE, PHASE.STARTING, PHASE.RECORDING, PHASE.STOPPING, PHASE.TRANSFERRING, PHASE.MERGING,
        PHASE.VERIFYING, PHASE.COMPLETE,
    ]  # fmt: skip
    assert fleet.commands == [
        Ask("main", "start"), Ask("second", "start"), MeasureClock("second", "start"),
        Ask("main", "stop"), Ask("second", "stop"), MeasureClock("second", "stop"),
        Transfer("second", "/rec/second", 1), CopyJournal(), Collect(),
    ]  # fmt: skip
    status = fleet.status
    assert (status.progress, status.location, status.message) == (1.0, "/rec/s1.bag", "1 MB, nothing was lost")


def test_it_records_only_when_every_platform_proves_it():
    fleet = Fleet()
    fleet.refuses["second"] = ""
    fleet.answer = lambda command: fleet.collector.answered(command.platform, command.verb, "s1", Answer(True))
    fleet.start()
    fleet.say("main", PHASE.RECORDING)
    fleet.say("second", PHASE.STARTING, message="realsense: nothing is written yet")
    fleet.go_on(5.0)
    status = fleet.status
    assert status.phase is PHASE.STARTING
    assert [(each.platform, each.growing, each.message) for each in status.platforms] == [
        ("main", True, ""),
        ("second", False, "second: realsense: nothing is written yet"),
    ]
    fleet.say("second", PHASE.RECORDING)
    fleet.go_on(0.2)
    assert fleet.collector.phase is PHASE.RECORDING


def test_a_second_platform_that_never_answers_is_named_within_the_limit():
    fleet = Fleet()
    fleet.silent["second"] = True
    fleet.start()
    fleet.go_on(11.9)
    assert fleet.collector.phase is PHASE.STARTING
    fleet.go_on(0.3)
    assert (fleet.status.phase, fleet.status.message) == (
        PHASE.FAILED,
        "second does not answer (no such service): is its data_recorder running, and its network up?",
    )
    assert len([each for each in fleet.asked(Ask) if each.platform == "second"]) == 12


def test_it_is_missing_in_the_end_as_well_and_a_retry_goes_on_when_it_answers():
    fleet = Fleet()
    fleet.silent["second"] = True
    fleet.start()
    fleet.go_on(13.0)
    fleet.stop()
    fleet.go_on(31.0)
    assert (fleet.status.phase, fleet.status.message) == (
        PHASE.FAILED,
        "the part of second is missing: second does not answer (no such service). Nothing was removed; "
        "the parts lie at main: /rec/main",
    )
    fleet.silent["second"] = False
    fleet.say("second", PHASE.COMPLETE)
    assert fleet.stop() == Answer(accepted=True)
    fleet.go_on(1.5)
    assert fleet.collector.phase is PHASE.TRANSFERRING


COMPUTER = PlatformStatus("second", free_fraction=0.75, cpu_fraction=0.5, clock_age_s=0.01)


def test_how_a_computer_is_is_told_before_any_session_and_not_of_one_that_is_silent():
    fleet = Fleet()
    fleet.said["second"] = Status(platforms=(COMPUTER,))
    (_, second) = fleet.go_on(0.5).status.platforms
    assert second == COMPUTER
    fleet.silent["second"] = True
    (_, second) = fleet.go_on(6.0).status.platforms
    assert second == PlatformStatus("second")


def test_a_platform_that_refuses_is_named_at_once():
    fleet = Fleet()
    fleet.refuses["second"] = "0.1 GB are free, make space"
    fleet.start()
    fleet.go_on(0.5)
    assert (fleet.status.phase, fleet.status.message) == (PHASE.FAILED, "second: 0.1 GB are free, make space")


def test_what_never_began_is_not_waited_for():
    fleet = Fleet()
    fleet.refuses["second"] = "no space"
    fleet.start()
    fleet.go_on(0.5)
    fleet.refuses["second"] = "session 's1' was not recorded here"
    fleet.stop()
    fleet.go_on(0.5)
    assert fleet.collector.phase is PHASE.MERGING
    assert fleet.asked(Transfer) == []


def test_a_platform_that_falls_silent_in_flight_is_said_and_one_that_forgot_is_asked_again():
    fleet = recording()
    fleet.silent["second"] = True
    fleet.go_on(6.0)
    assert fleet.status.platforms[1].growing is False
    assert fleet.status.platforms[1].message.startswith("second does not answer")
    assert fleet.status.phase is PHASE.RECORDING
    fleet.silent["second"] = False
    fleet.say("second", PHASE.IDLE, session="")
    fleet.go_on(0.5)
    assert fleet.asked(Ask)[-1] == Ask("second", "start")
    assert fleet.status.platforms[1].growing


def test_parts_are_fetched_again_until_the_limit_and_a_retry_fetches_what_is_missing():
    fleet, said = transferring(transfer_limit_ns=10_000_000_000), set()
    for _ in range(200):
        if fleet.collector.views["second"].fetching:
            fetched(fleet, "rsync: connection timed out")
        fleet.turn()
        if len(fleet.asked(Transfer)) == 2:
            said.add(fleet.status.platforms[1].message)
    assert 4 <= len(fleet.asked(Transfer)) <= 6
    assert "its part does not come (rsync: connection timed out); tried again for 7 s" in said
    assert (fleet.status.phase, fleet.status.message) == (
        PHASE.FAILED,
        "the part of second is missing: rsync: connection timed out. Nothing was removed; "
        "the parts lie at main: /rec/main; second: /rec/second",
    )
    fleet.stop()
    fleet.go_on(2.0)
    fetched(fleet)
    fleet.go_on(0.2)
    assert fleet.collector.phase is PHASE.MERGING


LIES = "Nothing was removed; the parts lie at main: /rec/main; second: /rec/second"


def test_a_fetch_that_hangs_fails_at_the_limit_and_a_retry_fetches_again():
    """As on a network file system that is mounted hard: nobody ever says that it has ended."""
    fleet = transferring(transfer_limit_ns=10 * S)
    fleet.go_on(9.0)
    assert fleet.collector.phase is PHASE.TRANSFERRING
    fleet.go_on(1.0)
    words = f"the part of second is missing: nothing more of it came for 10 s. {LIES}"
    assert (fleet.status.phase, fleet.status.message) == (PHASE.FAILED, words)
    assert fleet.commands[-1] == StopTransfer("second")
    fetched(fleet, number=1)
    assert fleet.stop() == Answer(accepted=True)
    fleet.go_on(3.0)
    assert fleet.asked(Transfer) == [Transfer("second", "/rec/second", 1), Transfer("second", "/rec/second", 2)]
    fleet.collector.transfer_progress(fleet.now_ns, "second", 1, 0.9)
    for problem in ("", "it was given up"):
        fetched(fleet, problem, number=1)
        fleet.go_on(3.0)
        assert (fleet.status.phase, fleet.status.progress) == (PHASE.TRANSFERRING, 0.0), "the old one has ended late"
    fetched(fleet, number=2)
    fleet.go_on(0.2)
    assert fleet.collector.phase is PHASE.MERGING


def test_a_fetch_of_the_session_before_says_nothing_of_the_next_one():
    fleet = transferring(transfer_limit_ns=10 * S)
    fleet.go_on(11.0)
    assert fleet.start("s2") == Answer(accepted=True)
    fleet.go_on(3.0)
    fleet.stop("s2")
    fleet.go_on(0.5)
    fetched(fleet, number=1)
    fleet.go_on(0.2)
    assert (fleet.asked(Transfer)[-1].number, fleet.collector.phase) == (2, PHASE.TRANSFERRING)


def test_a_fetch_that_comes_on_is_not_given_up_until_nothing_more_came_for_as_long_as_the_limit():
    fleet = transferring(transfer_limit_ns=10 * S)
    for percent in range(30):
        fleet.collector.transfer_progress(fleet.now_ns, "second", 1, percent / 100)
        fleet.go_on(1.0)
    fleet.collector.transfer_progress(fleet.now_ns, "second", 1, 0.29)
    fleet.go_on(8.0)
    assert fleet.collector.phase is PHASE.TRANSFERRING
    fleet.go_on(2.0)
    assert fleet.collector.phase is PHASE.FAILED


def test_progress_of_a_transfer_and_the_remaining_time_of_a_merge_are_told():
    fleet = transferring()
    fleet.collector.transfer_progress(fleet.now_ns, "second", 1, 0.4)
    fleet.turn()
    assert fleet.status.progress == pytest.approx(0.4)
    fetched(fleet)
    fleet.go_on(3.0)
    fleet.collector.job_progress(fleet.now_ns, PHASE.MERGING, 0.25)
    assert fleet.status.remaining_s == pytest.approx(9.0, abs=0.5)
    fleet.collector.job_progress(fleet.now_ns, PHASE.VERIFYING, 1.0)
    assert (fleet.status.progress, fleet.status.remaining_s) == (1.0, None)


def test_progress_of_a_recovery_is_that_of_all_platforms():
    fleet = recording()
    fleet.stop()
    for name, done in (("main", 0.5), ("second", 0.1)):
        fleet.answer = lambda _: None
        fleet.say(name, PHASE.RECOVERING)
        fleet.said[name] = replace(fleet.said[name], progress=done)
    fleet.go_on(0.3)
    assert (fleet.status.phase, fleet.status.progress) == (PHASE.RECOVERING, pytest.approx(0.3))


def test_a_job_that_is_killed_is_started_again_and_one_that_fails_is_not():
    fleet = merging()
    for _ in range(20):
        fleet.collector.job_ended(fleet.now_ns, "killed by SIGKILL", {}, killed=True)
        fleet.turn()
    assert (len(fleet.asked(Collect)), fleet.collector.phase) == (21, PHASE.MERGING)
    fleet.collector.job_ended(fleet.now_ns, "x.bag: there is no space for it; make space", {})
    fleet.go_on(1.0)
    assert (len(fleet.asked(Collect)), fleet.status.phase) == (21, PHASE.FAILED)
    assert fleet.status.message == "x.bag: there is no space for it; make space"
    assert fleet.status.location == "main:/rec/main, second:/rec/second"


def test_a_job_that_is_killed_for_ever_fails_in_the_end():
    fleet = merging()
    for _ in range(40):
        fleet.collector.job_ended(fleet.now_ns, "killed by SIGKILL", {}, killed=True)
        fleet.turn()
    assert (len(fleet.asked(Collect)), fleet.status.phase) == (25, PHASE.FAILED)


@pytest.mark.parametrize("keep, removed", [(True, []), (False, [Ask("main", "remove"), Ask("second", "remove")])])
def test_parts_are_removed_after_the_verified_end_only_and_only_when_configured(keep, removed):
    fleet = merging(keep_parts=keep)
    assert [each for each in fleet.asked(Ask) if each.verb == "remove"] == []
    fleet.collector.job_ended(fleet.now_ns, "", SUMMARY)
    fleet.go_on(3.0)
    assert [each for each in fleet.asked(Ask) if each.verb == "remove"] == removed


@pytest.mark.parametrize(
    "begun, now, removed",
    [(True, False, []), (False, True, []), (None, False, []), (False, False, ["main", "second"])],
)
def test_parts_are_removed_only_where_that_was_configured_when_they_were_begun_and_is_now(begun, now, removed):
    """Who wants no parts of the next flight has not said that those of the last one may go."""
    fleet = merging(keep_parts=begun is not False)
    fleet.collector.job_ended(fleet.now_ns, "", SUMMARY)
    memory = json.loads(json.dumps(fleet.collector.memory()))
    if begun is None:  # an earlier version did not write it down
        del memory["keep_parts"]
    later = Fleet(keep_parts=now)
    later.collector.remember(0, memory)
    later.go_on(1.0)
    assert [each.platform for each in later.asked(Ask)] == removed


def test_a_platform_that_fails_to_close_is_named_and_asked_again_on_a_retry():
    fleet = recording()
    fleet.answer = lambda command: (
        fleet.collector.answered(command.platform, command.verb, "s1", Answer(True)),
        fleet.say(command.platform, PHASE.COMPLETE if command.platform == "main" else PHASE.FAILED, message="broken"),
    )
    fleet.stop()
    fleet.go_on(2.0)
    assert (fleet.status.phase, fleet.status.message) == (
        PHASE.FAILED,
        "the part of second is missing: broken. Nothing was removed; "
        "the parts lie at main: /rec/main; second: /rec/second",
    )
    asked = len(fleet.asked(Ask))
    fleet.stop()
    fleet.go_on(3.0)
    assert fleet.asked(Ask)[asked:] == [Ask("second", "stop")]


def failed_in(phase):
    """Return a fleet whose collection failed in a phase."""
    fleet = transferring(transfer_limit_ns=10 * S)
    if phase is PHASE.TRANSFERRING:
        fleet.go_on(8.0)
        fetched(fleet, "rsync: no such file")
        fleet.go_on(2.0)
        fetched(fleet, "rsync: no such file")
        fleet.go_on(1.0)
    else:
        fetched(fleet)
        fleet.go_on(0.2)
        fleet.collector.job_progress(fleet.now_ns, phase, 0.5)
        fleet.collector.job_ended(fleet.now_ns, "x.bag: is not what was sent", {})
    assert fleet.collector.phase is PHASE.FAILED
    return fleet


def relisting(fleet, takes_s, final=PHASE.COMPLETE):
    """Have platforms that are asked to stop list their parts anew, and go on until they do; return when each was."""
    ends_ns, waits = {}, fleet.answer

    def answer(command):
        waits(command)
        fleet.say(command.platform, PHASE.RECOVERING)
        ends_ns[command.platform] = fleet.now_ns + round(takes_s * S)

    fleet.answer = answer
    for _ in range(round((takes_s + 3.0) * S / fleet.step_ns)):
        for name, end_ns in ends_ns.items():
            if fleet.now_ns >= end_ns:
                fleet.say(name, final, message="broken" if final is PHASE.FAILED else "")
        fleet.turn()
    return fleet


@pytest.mark.parametrize("phase", [PHASE.TRANSFERRING, PHASE.MERGING, PHASE.VERIFYING])
@pytest.mark.parametrize("takes_s", [0.0, 0.5, 20.0])
@pytest.mark.parametrize("killed", [False, True])
def test_after_a_collection_that_failed_a_retry_has_every_part_listed_anew_before_it_is_fetched(phase, takes_s, killed):
    fleet = failed_in(phase)
    if killed:
        memory = json.loads(json.dumps(fleet.collector.memory()))
        fleet.collector = Collector(fleet.collector.setup)
        fleet.collector.remember(fleet.now_ns, memory)
    done = len(fleet.commands)
    assert fleet.stop() == Answer(accepted=True)
    relisting(fleet, takes_s)
    stops = [Ask("main", "stop"), Ask("second", "stop")]
    asked = [each for each in fleet.commands[done:] if not isinstance(each, MeasureClock)]
    assert asked[:2] == stops
    assert [each.platform for each in asked[2:] if isinstance(each, Transfer)] == ["second"]
    assert len(asked) == 3
    assert fleet.collector.phase is PHASE.TRANSFERRING


def begun_anew(answers):
    """Return a fleet whose second platform was started anew, says COMPLETE, and was asked to record again."""
    fleet = recording().go_on(1.0)
    obeys, pending = fleet.answer, []

    def answer(command):
        if (command.platform, command.verb) != ("second", "start"):
            obeys(command)
        else:
            pending.append(command)
            if answers is not None:
                fleet.silent["second"] = True  # nothing is heard of it any more
                fleet.collector.answered("second", "start", "s1", answers)

    fleet.answer = answer
    fleet.say("second", PHASE.COMPLETE)
    fleet.go_on(0.1)
    assert pending == [Ask("second", "start")]
    return fleet


def test_a_word_from_before_it_was_asked_to_record_does_not_say_that_a_part_is_closed():
    """It was started anew in flight, and records again; the cable is cut before it can say so."""
    fleet = begun_anew(Answer(accepted=True))
    fleet.go_on(60.0)
    asked = len(fleet.commands)
    fleet.stop()
    fleet.go_on(2.0)
    assert set(fleet.commands[asked:]) == {Ask("main", "stop"), Ask("second", "stop")}
    fleet.go_on(40.0)
    assert (fleet.status.phase, fleet.status.message) == (
        PHASE.FAILED,
        f"the part of second is missing: second does not answer (no such service). {LIES}",
    )
    fleet.silent["second"] = False
    fleet.say("second", PHASE.RECORDING)
    fleet.stop()
    fleet.go_on(0.5)
    assert fleet.collector.phase is PHASE.TRANSFERRING


def test_a_platform_whose_answer_is_on_its_way_when_the_stop_is_asked_is_stopped_before_its_part_is_fetched():
    fleet = begun_anew(None)
    fleet.stop()
    fleet.go_on(1.5)
    assert (fleet.collector.phase, fleet.asked(Transfer)) == (PHASE.STOPPING, [])
    asked = len(fleet.commands)
    fleet.collector.answered("second", "start", "s1", Answer(accepted=True))
    fleet.go_on(0.5)
    assert fleet.commands[asked:] == [Ask("second", "stop")]
    assert fleet.collector.phase is PHASE.STOPPING, "the word before may still be on its way"
    fleet.go_on(1.0)
    assert fleet.collector.phase is PHASE.TRANSFERRING


def test_a_platform_that_was_asked_to_record_and_refused_is_closed_as_it_said():
    fleet = begun_anew(Answer(accepted=False, message="no space"))
    fleet.stop()
    asked = len(fleet.commands)
    fleet.go_on(0.5)
    assert Ask("second", "stop") not in fleet.commands[asked:]
    assert fleet.collector.phase is PHASE.TRANSFERRING


def test_nothing_is_fetched_while_a_part_is_listed_anew_though_the_word_before_that_was_complete():
    fleet = failed_in(PHASE.MERGING)
    asked = len(fleet.asked(Transfer))
    fleet.stop()
    relisting(fleet, 100.0)
    assert len(fleet.asked(Transfer)) == asked + 1
    assert fleet.phases[-3:] == [PHASE.STOPPING, PHASE.RECOVERING, PHASE.TRANSFERRING]


def test_a_retry_of_what_failed_before_the_collection_lists_nothing_anew():
    fleet = recording()
    fleet.collector.interrupted(fleet.now_ns)
    fleet.say("main", PHASE.COMPLETE)
    fleet.say("second", PHASE.COMPLETE)
    asked = len(fleet.asked(Ask))
    fleet.stop()
    fleet.go_on(0.5)
    assert (len(fleet.asked(Ask)), fleet.collector.phase) == (asked, PHASE.TRANSFERRING)


def test_a_platform_that_does_not_answer_any_more_is_not_asked_for_ever_for_a_new_list():
    """Its node has ended, and rsync needs its sshd only: its list has to do as it is."""
    fleet = failed_in(PHASE.MERGING)
    fleet.silent["second"] = True
    fleet.go_on(10.0)
    fleet.stop()
    relisting(fleet, 0.5)
    assert fleet.collector.phase is not PHASE.TRANSFERRING
    fleet.go_on(28.0)
    assert fleet.collector.phase is PHASE.TRANSFERRING


def test_a_part_that_was_not_listed_anew_is_asked_for_that_by_the_next_retry_or_the_next_process_as_well():
    fleet = failed_in(PHASE.MERGING)
    fleet.silent["second"] = True
    fleet.said["second"] = Status()  # its node was started anew, and knows nothing yet
    fleet.collector.heard(fleet.now_ns, "second", Status())
    fleet.stop()
    fleet.go_on(40.0)
    assert fleet.collector.phase is PHASE.FAILED
    fleet.silent["second"] = False
    fleet.say("second", PHASE.COMPLETE)
    fleet.stop()
    memory = json.loads(json.dumps(fleet.collector.memory()))
    for killed in (False, True):
        if killed:
            fleet.collector = Collector(fleet.collector.setup)
            fleet.collector.remember(fleet.now_ns, memory)
        asked = len(fleet.asked(Ask))
        fleet.go_on(3.0)
        assert fleet.asked(Ask)[asked:] == [Ask("main", "stop"), Ask("second", "stop")]
        assert fleet.collector.phase is PHASE.TRANSFERRING


def test_a_part_that_cannot_be_listed_anew_is_named():
    fleet = failed_in(PHASE.MERGING)
    fleet.stop()
    relisting(fleet, 0.5, PHASE.FAILED)
    assert (fleet.status.phase, fleet.status.message) == (
        PHASE.FAILED,
        f"the part of main is missing: broken; the part of second is missing: broken. {LIES}",
    )


def test_requests_are_answered_in_every_phase():
    fleet = transferring()
    assert fleet.start("s2") == Answer(accepted=False, message="busy with session s1 (TRANSFERRING)")
    assert fleet.stop("s1") == Answer(accepted=True)
    assert fleet.stop("s2") == Answer(accepted=False, message="session 's2' was not recorded here")
    assert fleet.start("") == Answer(accepted=False, message="a recording needs a session")


def engine(fleet, session, *, in_flight):
    fleet.collector.heard_engine(fleet.now_ns, fleet.now_ns, session, in_flight=in_flight)


RECORDS = Answer(accepted=False, message="records s1; stop that one first")


def test_another_session_is_refused_while_one_is_recorded_and_nobody_says_that_the_flight_is_over():
    fleet = recording()
    assert fleet.start("evil") == RECORDS, "no engine was heard"
    engine(fleet, "s1", in_flight=True)
    assert fleet.start("evil") == RECORDS
    engine(fleet, "s1", in_flight=False)
    fleet.go_on(6.0)
    assert fleet.start("evil") == RECORDS, "that was long ago"
    assert (fleet.collector.session_id, fleet.collector.phase) == ("s1", PHASE.RECORDING)
    assert fleet.stop("s1") == Answer(accepted=True)


@pytest.mark.parametrize("phase", [PHASE.FAILED, PHASE.COMPLETE])
def test_in_flight_no_other_session_begins_than_that_of_the_engine(phase):
    fleet = recording()
    engine(fleet, "s1", in_flight=True)
    if phase is PHASE.FAILED:
        fleet.collector.interrupted(fleet.now_ns)
    else:  # somebody has stopped it
        fleet.stop()
        fleet.go_on(0.5)
        fetched(fleet)
        fleet.go_on(0.2)
        fleet.collector.job_ended(fleet.now_ns, "", SUMMARY)
    assert fleet.start("evil") == Answer(accepted=False, message="session s1 is in flight")
    assert fleet.stop("s1") == Answer(accepted=True)
    other = Fleet()
    engine(other, "s1", in_flight=True)
    assert other.start("s1") == Answer(accepted=True), "a collector that remembers nothing"


def test_on_the_ground_a_new_session_begins_and_what_platforms_record_is_stopped_first():
    """An engine that was started anew without its journal asks for a session of its own."""
    fleet = recording()
    engine(fleet, "s2", in_flight=False)
    asked = len(fleet.commands)
    assert fleet.start("s2") == Answer(accepted=True)
    fleet.go_on(3.0)
    assert fleet.commands[asked:] == [
        Ask("main", "stop", "s1"), Ask("second", "stop", "s1"), Ask("main", "start"), Ask("second", "start"),
        MeasureClock("second", "start"),
    ]  # fmt: skip
    assert (fleet.collector.session_id, fleet.collector.phase) == ("s2", PHASE.RECORDING)


def test_a_platform_that_a_stranger_has_record_something_else_is_taken_back_in_flight():
    fleet = recording()
    engine(fleet, "s1", in_flight=True)
    asked = len(fleet.commands)
    fleet.say("second", PHASE.RECORDING, session="evil")
    fleet.go_on(3.0)
    assert fleet.commands[asked:] == [Ask("second", "stop", "evil"), Ask("second", "start")]
    assert fleet.status.platforms[1].growing


def test_a_bench_without_a_mission_may_record_whatever_the_engine_knows_of_the_vehicle():
    fleet = Fleet()
    engine(fleet, "", in_flight=True)
    assert fleet.start("bench") == Answer(accepted=True)


def test_a_new_session_forgets_the_last_one():
    fleet = merging()
    fleet.collector.job_ended(fleet.now_ns, "", SUMMARY)
    assert fleet.start("s2") == Answer(accepted=True)
    status = fleet.status
    assert (status.session_id, status.phase, status.location, status.message) == ("s2", PHASE.STARTING, "", "")


def test_a_clock_that_could_not_be_measured_is_asked_for_again():
    fleet = recording()
    assert fleet.asked(MeasureClock) == [MeasureClock("second", "start")]
    for number in (2, 3):
        fleet.collector.clock_measured("second", "start", None)
        fleet.go_on(4.0)
        assert len(fleet.asked(MeasureClock)) == number - 1, "not at once"
        fleet.go_on(2.0)
        assert fleet.asked(MeasureClock) == [MeasureClock("second", "start")] * number
    fleet.collector.clock_measured("second", "start", Offset(3, 1, 5))
    fleet.go_on(20.0)
    assert len(fleet.asked(MeasureClock)) == 3


def test_a_clock_that_could_not_be_measured_at_the_stop_is_asked_for_again_while_parts_come():
    """Else it may have been stepped, and all that its platform lacks counts."""
    fleet = transferring()
    fleet.measures = False
    fleet.collector.clock_measured("second", "stop", None)
    fleet.go_on(6.0)
    moments = [MeasureClock("second", when) for when in ("start", "stop", "stop")]
    assert fleet.asked(MeasureClock) == moments
    fetched(fleet)
    fleet.collector.clock_measured("second", "stop", None)
    fleet.silent["second"] = True
    fleet.go_on(0.2)
    assert fleet.collector.phase is PHASE.MERGING, "it is asked for in vain"


@pytest.mark.parametrize("answers", [False, True])
def test_a_merge_waits_for_a_clock_that_is_being_measured_and_not_for_ever(answers):
    fleet = recording()
    fleet.measures = False
    fleet.stop()
    fleet.go_on(0.5)
    fetched(fleet)
    fleet.go_on(2.0)
    assert fleet.collector.phase is PHASE.TRANSFERRING
    if answers:
        fleet.collector.clock_measured("second", "stop", Offset(3, 1, 5))
        fleet.go_on(0.2)
    else:
        fleet.go_on(3.0)
    assert (fleet.collector.phase, fleet.asked(Collect)) == (PHASE.MERGING, [Collect()])
    assert ("stop" in fleet.collector.views["second"].offsets) is answers


@pytest.mark.parametrize("killed", [False, True])
def test_the_clocks_of_a_session_that_goes_on_after_its_end_are_measured_again(killed):
    """The other computer may have been started anew meanwhile, with another clock."""
    fleet = merging()
    for when in ("start", "stop"):
        fleet.collector.clock_measured("second", when, Offset(0, 1, 5))
    fleet.collector.job_ended(fleet.now_ns, "", SUMMARY)
    assert fleet.start() == Answer(accepted=True)
    if killed:
        memory = json.loads(json.dumps(fleet.collector.memory()))
        fleet.collector = Collector(fleet.collector.setup)
        fleet.collector.remember(fleet.now_ns, memory)
    fleet.go_on(2.0)
    fleet.stop()
    fleet.go_on(2.0)
    moments = ["start", "stop", "start-2", "stop-2"]
    assert [each.when for each in fleet.asked(MeasureClock)] == moments
    fleet.collector.clock_measured("second", "start-2", Offset(3600 * S, 1, 9))
    offsets = fleet.collector.views["second"].offsets
    assert (list(offsets), offsets["start-2"].offset_ns) == (moments, 3600 * S)


def test_another_process_goes_on_where_this_one_was_killed():
    fleet = merging()
    fleet.collector.clock_measured("second", "start", Offset(3_000_000_000, 100, 5))
    memory = json.loads(json.dumps(fleet.collector.memory()))
    other = Fleet()
    other.collector = Collector(fleet.collector.setup)
    other.collector.remember(0, memory)
    other.say("main", PHASE.COMPLETE)
    other.say("second", PHASE.COMPLETE)
    other.go_on(0.3)
    assert other.commands == [CopyJournal(), Collect()]
    offsets = other.collector.views["second"].offsets
    assert (list(offsets), offsets["start"]) == (["start", "stop"], Offset(3_000_000_000, 100, 5))


@pytest.mark.parametrize("killed_in", [PHASE.RECORDING, PHASE.STOPPING])
def test_a_process_that_was_killed_before_asks_the_platforms_again(killed_in):
    fleet = recording()
    if killed_in is PHASE.STOPPING:
        fleet.answer = lambda command: fleet.collector.answered(command.platform, command.verb, "s1", Answer(True))
        fleet.stop()
        fleet.go_on(0.3)
    other = Fleet()
    other.collector.remember(0, json.loads(json.dumps(fleet.collector.memory())))
    other.say("main", PHASE.RECORDING)
    other.say("second", PHASE.RECORDING)
    other.go_on(0.3)
    assert other.collector.phase is (PHASE.RECORDING if killed_in is PHASE.RECORDING else PHASE.TRANSFERRING)


def test_a_node_that_is_ended_leaves_a_session_that_can_be_collected():
    fleet = recording()
    fleet.collector.interrupted(fleet.now_ns)
    assert fleet.status.phase is PHASE.FAILED
    assert fleet.stop() == Answer(accepted=True)
    fleet.go_on(0.5)
    assert fleet.collector.phase is PHASE.TRANSFERRING


def test_the_flight_is_from_the_last_status_on_the_ground_to_the_first_one_after_it():
    fleet = Fleet()
    fleet.start()
    assert fleet.collector.flights is None, "nobody said when it flew"
    for stamp_s, session, in_flight in (
        (1, "s1", False), (2, "s1", False), (3, "other", True), (4, "s1", True), (5, "s1", True), (6, "s1", False),
        (8, "s1", True),
    ):  # fmt: skip
        fleet.collector.heard_engine(stamp_s * S, stamp_s * S, session, in_flight=in_flight)
    assert fleet.collector.flights == [[2 * S, 6 * S], [6 * S, None]]
    again = Fleet().collector
    again.remember(0, json.loads(json.dumps(fleet.collector.memory())))
    assert again.flights == [[2 * S, 6 * S], [6 * S, None]]
    again.heard_engine(9 * S, 9 * S, "s1", in_flight=False)
    assert again.flights == [[2 * S, 6 * S], [6 * S, 9 * S]]
    fleet.stop()
    fleet.collector.start(fleet.now_ns, "s2", "m")
    assert fleet.collector.flights == [[2 * S, 6 * S], [6 * S, None]], "it is busy with the one before"


def test_what_is_kept_for_the_next_process_does_not_change_afterwards():
    """Else it is not written: a node that is killed in flight would not know when that began."""
    fleet = recording()
    kept = [fleet.collector.memory()]
    for in_flight in (False, True, False):
        engine(fleet, "s1", in_flight=in_flight)
        kept.append(fleet.collector.memory())
    now_ns = fleet.now_ns
    assert [each["flights"] for each in kept] == [None, [], [[now_ns, None]], [[now_ns, now_ns]]]


def test_a_stamp_that_is_wrong_makes_a_flight_longer_and_never_shorter():
    fleet = Fleet()
    fleet.start()
    for stamp_s, came_s, in_flight in ((99, 1, False), (3, 3, True), (1, 7, False)):
        fleet.collector.heard_engine(stamp_s * S, came_s * S, "s1", in_flight=in_flight)
    assert fleet.collector.flights == [[1 * S, 7 * S]]


@pytest.mark.parametrize("in_flight", [False, True])
def test_a_clock_that_is_set_back_while_the_session_is_recorded_is_noticed(in_flight):
    fleet = Fleet()
    fleet.start()
    for came_s in (100, 103, 102.95, 43, 44):
        fleet.collector.heard_engine(round(came_s * S), round(came_s * S), "s1", in_flight=in_flight)
    again = Fleet()
    again.collector.remember(0, json.loads(json.dumps(fleet.collector.memory())))
    assert [each.collector.set_back_ns for each in (fleet, again)] == [59_950_000_000] * 2
    engine(fleet, "s1", in_flight=False)
    fleet.collector.interrupted(fleet.now_ns)
    assert fleet.start("s2") == Answer(accepted=True)
    assert fleet.collector.set_back_ns == 0


def test_a_clock_that_is_set_back_while_the_node_is_started_again_is_noticed():
    """What is kept for the next process changes every 10 s, not with each status: it is put on the disk each time."""
    fleet, again = recording(), Fleet()
    kept = []
    for came_s in (101, 109, 110.5, 119):
        fleet.collector.heard_engine(round(came_s * S), round(came_s * S), "s1", in_flight=True)
        kept.append(json.dumps(fleet.collector.memory()))
    assert len(set(kept)) == 2
    again.collector.remember(0, json.loads(kept[-1]))
    again.collector.heard_engine(79 * S, 79 * S, "s1", in_flight=True)
    assert again.collector.set_back_ns == 31 * S, "so much at least"


@pytest.mark.parametrize("phase", [PHASE.RECORDING, PHASE.FAILED])
def test_a_clock_that_is_set_back_before_the_stop_is_noticed_and_one_before_a_retry_is_no_matter(phase):
    fleet = recording()
    fleet.collector.heard_engine(100 * S, 100 * S, "s1", in_flight=False)
    if phase is PHASE.FAILED:
        fleet.collector.interrupted(fleet.now_ns, 101 * S)
    fleet.collector.stop(fleet.now_ns, "s1", 40 * S)
    assert fleet.collector.set_back_ns == (60 * S if phase is PHASE.RECORDING else 0)


def test_a_takeoff_that_nobody_saw_is_as_old_as_the_recording():
    fleet = Fleet()
    fleet.start()
    fleet.collector.heard_engine(5 * S, 5 * S, "s1", in_flight=True)
    assert fleet.collector.flights == [[0, None]]


def test_what_the_flight_lacks_is_in_the_status_of_a_complete_recording_and_nowhere_else():
    fleet = merging()
    fleet.collector.job_ended(fleet.now_ns, "", {"location": "/rec/all.bag", "lost_in_flight": ["a: 1 s", "b: 2 s"]})
    assert (fleet.status.phase, fleet.status.lost) == (PHASE.COMPLETE, "a: 1 s; b: 2 s")
    fleet.collector.start(fleet.now_ns, "s2", "m")
    assert fleet.status.lost == ""


def test_what_was_wanted_of_a_session_is_what_was_configured_when_it_began():
    """Who changes the configuration after the flight, and collects then, has lost nothing by that."""
    before, after = ({"main": {"states": configured([topic])}} for topic in ("/a", "/b"))
    fleet, later = Fleet(wanted=before), Fleet(wanted=after)
    fleet.start()
    assert fleet.collector.wanted == before
    later.collector.remember(0, json.loads(json.dumps(fleet.collector.memory())))
    assert later.collector.wanted == before
    assert later.start() == Answer(accepted=True, message="already so")
    assert later.collector.wanted == before
    later.collector.interrupted(later.now_ns)
    assert later.start("s2") == Answer(accepted=True)
    assert later.collector.wanted == after


@pytest.mark.parametrize("again", [False, True])
def test_a_platform_that_was_taken_out_of_the_configuration_stays_one_of_the_session(again):
    """Its part did not come; what it recorded lies there yet, and with its platform put back it is fetched."""
    fleet = recording()
    fleet.silent["second"] = True
    fleet.stop()
    fleet.go_on(60)
    assert fleet.collector.phase is PHASE.FAILED
    later = Fleet(platforms=("main",))
    later.collector.remember(0, json.loads(json.dumps(fleet.collector.memory())))
    assert list(later.collector.taken_out) == ["second"]
    later.say("main", PHASE.COMPLETE)
    later.stop()
    later.go_on(2)
    assert {each.platform for each in later.asked(Ask)} <= {"main"}
    assert later.asked(Transfer) == [], "nobody says how"
    assert later.asked(Collect) == [Collect()]
    if again:
        back = Fleet()
        back.collector.remember(0, json.loads(json.dumps(later.collector.memory())))
        assert (list(back.collector.views), back.collector.taken_out) == (["main", "second"], {})
        assert back.collector.views["second"].part.location == "/rec/second"
    else:
        later.collector.job_ended(later.now_ns, "no space", {})
        assert later.status.location == "main:/rec/main, second:/rec/second"
        later.collector.start(later.now_ns, "s2", "m")
        assert later.collector.taken_out == {}


def test_of_a_session_of_an_earlier_version_what_is_configured_now_was_wanted():
    fleet = Fleet()
    fleet.start()
    memory = fleet.collector.memory()
    del memory["wanted"]
    later = Fleet(wanted={"main": {}})
    later.collector.remember(0, memory)
    assert later.collector.wanted == {"main": {}}
