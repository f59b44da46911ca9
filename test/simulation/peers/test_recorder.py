"""The simulated recorder, seen through its services and its status."""

import pytest
from simulation_tools import Driver, changes

from amaze_autonomy.engine.events import Outcome, RecordingPhase, RecordingStatus

PHASE = RecordingPhase
WAY = [
    PHASE.IDLE, PHASE.STARTING, PHASE.RECORDING, PHASE.STOPPING, PHASE.RECOVERING,
    PHASE.TRANSFERRING, PHASE.MERGING, PHASE.VERIFYING, PHASE.COMPLETE,
]  # fmt: skip


def phases(driver):
    return changes(driver.events, RecordingStatus, "phase")


def recorded(driver, seconds=5.0):
    driver.go_on(0.5)
    assert driver.record().outcome is Outcome.ACCEPTED
    driver.go_on(seconds)
    return driver


def test_goes_all_the_way_from_idle_to_a_complete_recording():
    driver = recorded(Driver())
    assert driver.stop_recording().outcome is Outcome.ACCEPTED
    driver.go_on(10.0)
    assert phases(driver) == WAY
    assert (driver.recorder.progress, driver.recorder.location) == (1.0, "")
    assert {part.location for part in driver.recorder.platforms} == {""}, "it names no file: there is none"


def test_the_files_of_both_platforms_grow_while_it_records_and_not_afterwards():
    driver = recorded(Driver())
    first = [platform.written_bytes for platform in driver.recorder.platforms]
    assert [(each.platform, each.growing) for each in driver.recorder.platforms] == [("main", True), ("second", True)]
    driver.go_on(2.0)
    later = [platform.written_bytes for platform in driver.recorder.platforms]
    assert all(after > before > 0 for before, after in zip(first, later))
    assert later[0] - first[0] == pytest.approx(2 * 25_000_000, rel=0.01)
    driver.stop_recording()
    driver.go_on(1.0)
    assert [each.growing for each in driver.recorder.platforms] == [False, False]


def test_tells_its_progress_within_a_phase():
    driver = recorded(Driver())
    driver.stop_recording()
    driver.go_on(10.0)
    progress = [e.progress for e in driver.events if isinstance(e, RecordingStatus) and e.phase is PHASE.TRANSFERRING]
    assert len(progress) >= 5
    assert progress == sorted(progress)
    assert 0.0 <= progress[0] < 0.3
    assert 0.7 < progress[-1] <= 1.0


def test_a_second_start_of_the_same_session_is_already_so_and_another_session_is_refused():
    driver = recorded(Driver())
    assert driver.record().outcome is Outcome.ACCEPTED
    reply = driver.record("b")
    assert (reply.outcome, reply.message) == (Outcome.REFUSED, "busy with session a (RECORDING)")
    assert driver.recorder.phase is PHASE.RECORDING


def test_refuses_to_stop_what_it_does_not_record():
    driver = recorded(Driver())
    assert driver.stop_recording("b").outcome is Outcome.REFUSED
    driver.go_on(1.0)
    assert driver.recorder.phase is PHASE.RECORDING


def test_records_again_after_it_is_complete():
    driver = recorded(Driver())
    driver.stop_recording()
    driver.go_on(10.0)
    assert driver.record("b").outcome is Outcome.ACCEPTED
    driver.go_on(2.0)
    status = driver.recorder
    assert (status.phase, status.session_id, status.location) == (PHASE.RECORDING, "b", "")
    assert status.platforms[0].written_bytes < 2.5 * 25_000_000


def test_a_platform_whose_files_do_not_grow_keeps_it_from_recording_until_they_do():
    driver = recorded(Driver("fault: recording_does_not_grow, platform: main, for_s: 20"))
    assert driver.recorder.phase is PHASE.STARTING
    assert [(p.growing, p.message) for p in driver.recorder.platforms] == [(False, "its files do not grow"), (True, "")]
    driver.go_on(20.0)
    assert driver.recorder.phase is PHASE.RECORDING


def test_a_missing_part_fails_the_verification_and_a_retry_goes_on_from_there():
    driver = recorded(Driver("fault: data_incomplete, platform: second, for_s: 30"))
    driver.stop_recording()
    driver.go_on(10.0)
    status = driver.recorder
    assert (status.phase, status.location) == (PHASE.FAILED, "")
    assert status.message == "the part of platform second is missing; the parts are kept"
    driver.stop_recording()
    driver.go_on(10.0)
    assert driver.recorder.phase is PHASE.FAILED
    driver.go_on(10.0)
    driver.stop_recording()
    driver.go_on(10.0)
    assert driver.recorder.phase is PHASE.COMPLETE
    assert phases(driver)[-4:] == [PHASE.TRANSFERRING, PHASE.MERGING, PHASE.VERIFYING, PHASE.COMPLETE]


def test_a_recorder_that_ends_by_itself_fails_the_recording():
    driver = recorded(Driver("fault: recording_fails, at_s: 4"))
    assert driver.recorder.phase is PHASE.FAILED
    assert driver.recorder.message == "the recorder of platform second has ended by itself"


def test_a_killed_one_says_nothing_and_one_that_is_silent_goes_on():
    driver = recorded(Driver("process: data_recorder, fault: killed, at_s: 3"))
    assert max(e.t_ns for e in driver.events if isinstance(e, RecordingStatus)) <= 3_000_000_000
    assert driver.stop_recording().outcome is Outcome.UNAVAILABLE
    driver = recorded(Driver("process: data_recorder, fault: silent, at_s: 3, for_s: 4"))
    assert driver.stop_recording().outcome is Outcome.ACCEPTED
    driver.go_on(10.0)
    assert driver.recorder.phase is PHASE.COMPLETE
