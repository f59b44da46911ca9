"""The recorder of one platform: it proves, restarts, stops with limits, and goes on where a process of it ended."""

import json
from dataclasses import replace

import pytest
import recording_story
from recording_story import EPOCH_NS, PHASE, Platform, S, recorded_memory, recording, recovered, stopped

from amaze_autonomy.recording import Answer, GroupSetup, PlatformRecorder
from amaze_autonomy.recording.parts import close_parts
from amaze_autonomy.recording.status import UNWANTED, Recover, Signal, StartChild, configured
from amaze_autonomy.recording.storage import read_parts


def test_goes_all_the_way_from_idle_to_a_complete_part():
    platform = recording()
    assert platform.stop() == Answer(accepted=True)
    platform.go_on(0.3)
    recovered(platform)
    assert platform.phases == [
        PHASE.IDLE, PHASE.STARTING, PHASE.RECORDING, PHASE.STOPPING, PHASE.RECOVERING, PHASE.COMPLETE,
    ]  # fmt: skip
    assert platform.commands == [
        StartChild("states", 1), StartChild("cameras", 1), Signal("states", "INT"), Signal("cameras", "INT"), Recover(),
    ]  # fmt: skip


def test_it_records_only_when_every_group_writes_more_than_the_head_of_an_empty_bag():
    platform = Platform()
    platform.grows["cameras"] = 0
    platform.sizes["cameras"] = 4117
    platform.start()
    platform.go_on(5.0)
    assert platform.machine.phase is PHASE.STARTING
    assert (platform.part.growing, platform.part.message) == (False, "cameras: nothing is written yet")
    platform.grows["cameras"] = 1000
    platform.go_on(1.0)
    assert (platform.machine.phase, platform.part.growing, platform.part.message) == (PHASE.RECORDING, True, "")


def test_a_slow_group_is_proven_by_its_first_message_whatever_it_had_written_when_it_was_first_looked_at():
    platform = Platform(groups=("states",))
    platform.grows["states"] = 4117
    platform.start()
    platform.go_on(0.2)
    platform.grows["states"] = 0
    platform.go_on(5.0)
    assert (platform.sizes["states"], platform.machine.phase) == (4117, PHASE.STARTING)
    platform.sizes["states"] += 237
    platform.turn()
    assert platform.machine.phase is PHASE.RECORDING
    other = Platform(groups=("states",))
    other.running["states"], other.sizes["states"], other.grows["states"] = True, 4354, 0
    other.machine.remember(0, recorded_memory(platform), same_boot=True)
    assert not other.go_on(0.5).part.growing
    other.sizes["states"] += 72
    assert other.go_on(0.2).part.growing


def test_what_its_copy_of_the_configuration_lacks_is_said_while_it_records_and_in_no_other_phase():
    platform = Platform()
    own = {each.name: each.configured for each in platform.machine.setup.groups}
    lacks = ["/more and /most are not in its configuration"]
    assert platform.machine.compare({**own, "other": configured(["/more", "/most"])}) == lacks
    assert platform.part.message == ""
    platform.start()
    platform.go_on(1.0)
    assert (platform.machine.phase, platform.part.growing, platform.part.message) == (PHASE.RECORDING, True, lacks[0])
    platform.stop()
    assert platform.part.message == ""
    platform.go_on(0.3)
    recovered(platform)
    platform.start("s2")
    assert platform.go_on(1.0).part.message == lacks[0]
    assert platform.machine.compare(own) == []
    assert platform.part.message == ""


@pytest.mark.parametrize("wanted", [None, [], {"a": None}, {"a": {"topics": ["/b"]}}, {"a": {"topics": 3}}], ids=str)
def test_what_cannot_be_compared_is_an_error_and_changes_nothing(wanted):
    platform = recording()
    platform.machine.compare({"a": configured(["/more"])})
    with pytest.raises((AttributeError, KeyError, TypeError)):
        platform.machine.compare(wanted)
    assert platform.part.message == "/more is not in its configuration"


def test_it_does_not_record_while_a_topic_is_not_subscribed_or_the_master_says_nothing():
    platform = Platform()
    platform.missing["states"] = ("/states",)
    platform.start()
    platform.go_on(2.0)
    assert (platform.machine.phase, platform.part.message) == (PHASE.STARTING, "states: not subscribed to /states")
    platform.missing["states"] = None
    platform.go_on(0.2)
    assert platform.part.message == "states: the master does not say what is subscribed"
    platform.missing["states"] = ()
    platform.go_on(0.2)
    assert platform.machine.phase is PHASE.RECORDING


def test_a_group_that_nobody_publishes_is_proven_by_its_subscription_but_not_alone():
    platform = Platform()
    platform.grows["cameras"], platform.silent["cameras"] = 0, True
    platform.start()
    platform.go_on(1.0)
    assert (platform.machine.phase, platform.part.growing) == (PHASE.RECORDING, True)
    assert platform.part.message == "cameras: nobody publishes its topics"
    alone = Platform(groups=("cameras",))
    alone.grows["cameras"], alone.silent["cameras"] = 0, True
    alone.start()
    alone.go_on(5.0)
    assert alone.machine.phase is PHASE.STARTING


def test_files_that_do_not_grow_for_a_while_are_said():
    platform = recording()
    platform.grows = dict.fromkeys(platform.grows, 0)
    platform.go_on(2.5)
    assert platform.part.growing
    platform.go_on(1.0)
    assert (platform.part.growing, platform.part.message) == (False, "its files do not grow")
    assert platform.machine.phase is PHASE.RECORDING


def test_a_recorder_that_is_killed_is_started_at_once_into_a_new_file_and_said():
    platform = recording()
    platform.kill("cameras")
    platform.turn()
    assert platform.commands[-1] == StartChild("cameras", 2)
    assert platform.part.message == "cameras: its recorder ended (killed by SIGKILL)"
    platform.go_on(0.5)
    assert platform.part.growing
    assert platform.part.message == "cameras: its recording was interrupted once, 0.2 s are missing"
    at = {"from_ns": EPOCH_NS + S, "to_ns": EPOCH_NS + 1_200_000_000}
    assert platform.machine.groups["cameras"].gaps == [
        {"group": "cameras", "file": 2, "seconds": 0.2, "ending": "killed by SIGKILL", **at}
    ]


def test_what_is_kept_for_the_next_process_does_not_change_afterwards():
    platform = recording()
    kept = platform.machine.memory()
    before = json.dumps(kept)
    platform.kill("cameras")
    platform.go_on(1.0)
    assert json.dumps(kept) == before
    again = json.loads(json.dumps(platform.machine.memory()))
    platform.machine.remember(0, again, same_boot=True)
    assert [gap["seconds"] for gap in platform.machine.groups["cameras"].gaps] == [0.2]


def test_a_recorder_that_dies_again_and_again_is_started_once_a_second():
    platform = recording()
    for _ in range(50):
        platform.kill("cameras", "it ended with status 1")
        platform.turn()
    assert 5 <= len([each for each in platform.asked(StartChild) if each.group == "cameras"]) - 1 <= 6


def test_a_recorder_that_does_not_come_is_asked_for_again():
    platform = Platform()
    platform.carry_out = lambda _: None
    platform.start()
    platform.go_on(11.0)
    assert [each.number for each in platform.asked(StartChild) if each.group == "states"] == [1, 2, 3]


def test_without_space_it_does_not_begin():
    platform = Platform()
    assert platform.start(problem="0.1 GB are free") == Answer(accepted=False, message="0.1 GB are free")
    platform.go_on(1.0)
    assert (platform.phases, platform.commands) == ([PHASE.IDLE], [])


def test_a_storage_that_becomes_full_is_said_before_and_ends_the_recorders_so_that_their_files_are_closed():
    platform = recording()
    platform.free = 50_000_000 + 200_000_000
    platform.turn()
    assert platform.part.message == "the storage is full in 25 s"
    platform.free = 100_000_000
    platform.go_on(3.0)
    assert platform.asked(Signal) == [Signal("states", "INT"), Signal("cameras", "INT")]
    assert platform.part.message.startswith("the storage is full (100 MB are free): recording has stopped; ")
    assert [each.number for each in platform.asked(StartChild) if each.group == "states"] == [1]
    platform.free = 300_000_000
    platform.go_on(1.0)
    assert [each.number for each in platform.asked(StartChild) if each.group == "states"] == [1]
    platform.free = 10_000_000_000
    platform.go_on(1.0)
    assert [each.number for each in platform.asked(StartChild) if each.group == "states"] == [1, 2]
    (gap,) = platform.machine.groups["states"].gaps
    assert (gap["ending"], round(gap["seconds"])) == ("the storage was full", 4)


def test_a_recorder_that_does_not_end_on_a_full_storage_is_asked_once():
    platform = recording()
    platform.obeys = dict.fromkeys(platform.obeys, ())
    platform.free = 0
    platform.go_on(3.0)
    assert len(platform.asked(Signal)) == 2


def test_what_a_full_storage_took_is_a_loss_and_ends_with_the_recording():
    platform = recording()
    platform.grows = dict.fromkeys(platform.grows, 0)
    platform.full["states"] = True
    platform.go_on(5.0)
    platform.stop()
    platform.turn()
    (gap,) = platform.machine.groups["states"].gaps
    assert (gap["ending"], round(gap["seconds"])) == ("the storage was full", 5)


def test_a_recorder_that_died_and_could_not_be_started_is_a_loss_as_well():
    platform = recording()
    platform.free = 0
    platform.kill("states")
    platform.go_on(5.0)
    platform.stop()
    (gap,) = platform.machine.groups["states"].gaps
    assert (gap["ending"], round(gap["seconds"])) == ("killed by SIGKILL", 5)


def test_a_recorder_that_writes_again_when_there_is_space_ends_the_gap():
    platform = recording()
    platform.grows = dict.fromkeys(platform.grows, 0)
    platform.full["states"] = True
    platform.go_on(2.0)
    platform.grows = dict.fromkeys(platform.grows, 2_000_000)
    platform.go_on(0.1)
    assert platform.part.message == "states: its recording was interrupted once, 2.1 s are missing"


def test_dropped_messages_are_counted():
    platform = recording()
    platform.dropped["cameras"] = 3
    platform.turn()
    assert (platform.part.dropped, platform.part.message) == (3, "cameras: messages were dropped, at least 3")


def test_a_recorder_that_does_not_close_its_file_is_made_to():
    platform = recording()
    platform.obeys["cameras"] = ("KILL",)
    platform.stop()
    platform.go_on(33.0)
    signals = [(each.name, each.group) for each in platform.asked(Signal)]
    assert signals == [("INT", "states"), ("INT", "cameras"), ("TERM", "cameras"), ("KILL", "cameras")]
    assert platform.machine.phase is PHASE.RECOVERING


def test_a_recovery_that_fails_is_told_and_done_again_when_asked():
    platform = recording()
    platform.stop()
    platform.go_on(0.3)
    recovered(platform, "states-01.bag.active: there is no space")
    status = platform.machine.status(platform.now_ns)
    assert (status.phase, status.message) == (PHASE.FAILED, "states-01.bag.active: there is no space")
    assert platform.stop() == Answer(accepted=True)
    platform.go_on(0.1)
    assert len(platform.asked(Recover)) == 2
    recovered(platform)
    assert platform.machine.phase is PHASE.COMPLETE


def test_a_part_that_is_complete_is_listed_anew_when_it_is_asked_to_stop_again():
    """A collection of it has failed. Until that is done, nothing is removed."""
    platform = stopped(recording())
    assert "anew" not in platform.machine.facts()
    assert platform.stop() == Answer(accepted=True)
    assert (platform.machine.phase, platform.machine.facts()["anew"]) == (PHASE.RECOVERING, True)
    assert not platform.machine.may_remove("s1", keep=False).accepted
    other = Platform()
    other.machine.remember(0, recorded_memory(platform), same_boot=True)
    assert (other.machine.phase, other.machine.facts()["anew"]) == (PHASE.RECOVERING, True)
    platform.go_on(0.1)
    assert len(platform.asked(Recover)) == 2
    recovered(platform, "states-01.bag: cannot be read")
    assert platform.stop() == Answer(accepted=True)
    assert platform.machine.facts()["anew"], "it is still the same list that was found wrong"
    platform.go_on(0.1)
    recovered(platform)
    assert platform.machine.phase is PHASE.COMPLETE
    platform.start()
    assert "anew" not in platform.machine.facts(), "what it lists next is another recording"


def test_a_recovery_that_is_killed_is_started_again_without_being_asked():
    platform = recording()
    platform.stop()
    platform.go_on(0.3)
    platform.machine.recovery_ended(platform.now_ns, "killed by SIGKILL", killed=True)
    platform.go_on(0.1)
    assert (platform.machine.phase, len(platform.asked(Recover))) == (PHASE.RECOVERING, 2)


def test_while_a_session_is_recorded_another_one_is_refused():
    platform = recording()
    assert platform.start() == Answer(accepted=True, message="already so")
    refused = Answer(accepted=False, message="records s1; stop that one first")
    assert platform.start("s2") == platform.start("s2", problem="0.1 GB are free") == refused
    platform.go_on(1.0)
    assert (platform.machine.session_id, platform.machine.phase, platform.part.growing) == ("s1", PHASE.RECORDING, True)
    assert platform.asked(Signal) == []


def test_another_session_begins_when_the_part_of_this_one_is_closed():
    platform = recording()
    platform.stop()
    assert platform.start("s2") == Answer(accepted=True, message="session s1 is closed first")
    platform.go_on(0.5)
    platform.numbers = dict.fromkeys(platform.numbers, 0)  # its folder is another one
    recovered(platform)
    platform.go_on(1.0)
    assert (platform.machine.session_id, platform.machine.phase) == ("s2", PHASE.RECORDING)
    assert [each.number for each in platform.asked(StartChild) if each.group == "states"] == [1, 1]


def numbers(platform, group="states"):
    return [each.number for each in platform.asked(StartChild) if each.group == group]


def test_a_session_that_is_taken_up_again_goes_on_in_new_files_and_knows_what_it_has_lost():
    platform = recording()
    platform.kill("cameras")
    platform.dropped["states"] = 3
    platform.go_on(1.0)
    (lost,) = platform.machine.facts()["gaps"]
    stopped(platform)
    platform.dropped["states"] = 0
    platform.numbers = dict.fromkeys(platform.numbers, 0)
    platform.start("evil")
    stopped(platform.go_on(1.0), "evil")
    assert platform.machine.facts()["gaps"] == []
    platform.numbers = {"states": 1, "cameras": 2}
    platform.start()
    platform.go_on(1.0)
    assert (numbers(platform), numbers(platform, "cameras")) == ([1, 1, 2], [1, 2, 1, 3])
    facts = platform.machine.facts()
    assert facts["dropped"] == 3
    assert [(each["group"], each["file"], each["ending"]) for each in facts["gaps"]] == [
        ("states", 2, "it was stopped and started again"),
        ("cameras", 2, lost["ending"]),
        ("cameras", 3, "it was stopped and started again"),
    ]


def test_another_process_knows_sessions_that_were_left():
    platform = stopped(recording())
    platform.numbers = dict.fromkeys(platform.numbers, 0)
    platform.start("evil")
    stopped(platform.go_on(1.0), "evil")
    other = Platform()
    other.machine.remember(0, recorded_memory(platform), same_boot=True)
    other.numbers = dict.fromkeys(other.numbers, 1)
    other.turn()
    other.start()
    other.go_on(1.0)
    assert numbers(other) == [2]
    assert [each["file"] for each in other.machine.facts()["gaps"]] == [2, 2]


def test_what_is_known_of_sessions_that_were_left_does_not_grow_for_ever():
    platform = Platform(groups=("states",))
    for number in range(20):
        platform.numbers["states"] = 0
        platform.start(f"s{number}")
        stopped(platform.go_on(0.5), f"s{number}")
    assert [session for session, _ in platform.machine.memory()["left"]] == [f"s{number}" for number in range(11, 19)]


def test_files_that_lie_there_already_are_never_written_over_though_nobody_remembers_them():
    platform = Platform()
    platform.numbers = {"states": 4, "cameras": 0}
    platform.start()
    platform.go_on(1.0)
    assert platform.commands == [StartChild("states", 5), StartChild("cameras", 1)]
    platform.kill("states")
    platform.numbers["states"] = 8
    platform.go_on(1.0)
    assert platform.commands[-1] == StartChild("states", 9)


def test_a_recording_that_was_stopped_and_goes_on_has_a_gap():
    platform = recording()
    stopped(platform)
    platform.go_on(30.0 - 0.4)
    platform.start()
    platform.go_on(1.0)
    (states, cameras) = platform.machine.facts()["gaps"]
    at = {"from_ns": EPOCH_NS + S, "to_ns": EPOCH_NS + 31_200_000_000}
    assert states == {"group": "states", "file": 2, "seconds": 30.2, "ending": "it was stopped and started again", **at}
    assert cameras == {**states, "group": "cameras"}
    words = "{0}: its recording was interrupted once, 30.2 s are missing"
    assert platform.part.message == f"{words.format('states')}; {words.format('cameras')}"


def test_where_a_clock_was_set_back_in_a_pause_nobody_knows_how_long_it_was_and_the_list_is_one(tmp_path, monkeypatch):
    """By NTP in two seconds of a pause; or a computer is started anew without a battery for its clock."""
    platform = recording()
    stopped(platform)
    monkeypatch.setattr(recording_story, "EPOCH_NS", EPOCH_NS - 5 * S)
    platform.silent["cameras"] = True
    platform.go_on(2.0 - 0.4)
    platform.start()
    platform.go_on(1.0)
    states, cameras = (
        f"{name}: its recording was interrupted once, an unknown time is missing (its clock was set back)"
        for name in ("states", "cameras")
    )
    assert platform.part.message == f"{states}; cameras: nobody publishes its topics; {cameras}"
    content = close_parts(tmp_path, platform.machine.facts())
    assert [gap["seconds"] for gap in content["gaps"]] == [None, None]
    assert content["set_back"] == ["states", "cameras"]
    assert read_parts(tmp_path) == content


def test_a_group_that_nobody_publishes_has_no_longer_gap_than_until_its_recorder_is_subscribed():
    platform = Platform()
    platform.grows["cameras"], platform.silent["cameras"] = 0, True
    platform.start()
    stopped(platform.go_on(1.0))
    platform.start()
    platform.go_on(5.0)
    (gap,) = (each for each in platform.machine.facts()["gaps"] if each["group"] == "cameras")
    assert gap["to_ns"] - gap["from_ns"] < S


def test_the_list_says_from_when_to_when_recorders_were_seen():
    platform = recording()
    seen = {"file": 1, "from_ns": EPOCH_NS + S // 5, "to_ns": None}
    assert platform.machine.facts()["seen"] == {"states": seen, "cameras": seen}
    platform.go_on(1.0)
    stopped(platform)
    ended = {**seen, "to_ns": EPOCH_NS + 2 * S}
    assert platform.machine.facts()["seen"] == {"states": ended, "cameras": ended}
    other = Platform()
    other.machine.remember(0, recorded_memory(platform), same_boot=True)
    assert other.machine.facts()["seen"] == {"states": ended, "cameras": ended}


def test_a_recorder_is_seen_when_it_is_subscribed_and_the_clock_that_stamps_is_known():
    platform = Platform()
    platform.missing["states"] = ("/states",)
    platform.start()
    platform.go_on(2.0)
    assert platform.machine.facts()["seen"]["states"] == {"file": None, "from_ns": None, "to_ns": None}
    platform.missing["states"] = ()
    platform.turn()
    assert platform.machine.facts()["seen"]["states"]["from_ns"] == EPOCH_NS + platform.now_ns


def test_what_was_kept_before_recorders_were_seen_is_taken_up():
    memory = recorded_memory(recording())
    del memory["left"]
    for group in memory["groups"].values():
        del group["seen"]
    other = Platform()
    other.machine.remember(0, memory, same_boot=False)
    nobody = {"file": None, "from_ns": None, "to_ns": None}
    assert other.machine.facts()["seen"] == {"states": nobody, "cameras": nobody}


def test_a_start_after_a_failure_or_a_part_that_is_closed_goes_on_in_new_files():
    platform = recording()
    platform.stop()
    platform.go_on(0.3)
    recovered(platform)
    assert platform.start() == Answer(accepted=True)
    platform.go_on(1.0)
    assert [each.number for each in platform.asked(StartChild) if each.group == "states"] == [1, 2]
    assert platform.machine.phase is PHASE.RECORDING


def test_a_stop_for_another_session_or_without_one_is_refused():
    platform = recording()
    assert platform.stop("x") == Answer(accepted=False, message="session 'x' was not recorded here")
    assert platform.start("") == Answer(accepted=False, message="a recording needs a session")


def test_another_process_keeps_recorders_that_run_and_starts_those_that_ended():
    first, second = recording(), Platform()
    second.running, second.sizes = dict(first.running), dict(first.sizes)
    second.kill("cameras", "it ended while this node was away")
    second.machine.remember(0, recorded_memory(first), same_boot=True)
    second.go_on(1.0)
    assert second.commands == [StartChild("cameras", 2)]
    assert second.part.growing
    assert second.machine.groups["cameras"].gaps[0]["ending"] == "it ended while this node was away"


def test_a_recorder_that_ended_while_nobody_watched_has_a_gap_since_its_files_grew_last():
    first, second = recording(), Platform()
    second.running, second.sizes = dict(first.running), dict(first.sizes)
    second.kill("cameras", "it ended while this node was away")
    second.idle["cameras"] = 20 * S
    second.machine.remember(0, recorded_memory(first), same_boot=True)
    second.go_on(1.0)
    (gap,) = second.machine.groups["cameras"].gaps
    at = {"from_ns": EPOCH_NS - 19_900_000_000, "to_ns": EPOCH_NS + 200_000_000}
    assert gap == {"group": "cameras", "file": 2, "seconds": 20.1, "ending": "it ended while this node was away", **at}
    assert second.machine.groups["states"].gaps == []


def test_after_a_start_of_the_system_what_was_recorded_is_made_whole():
    first, second = recording(), Platform()
    second.machine.remember(0, recorded_memory(first), same_boot=False)
    second.go_on(0.3)
    assert second.commands == [Recover()]
    recovered(second)
    status = second.machine.status(second.now_ns)
    assert (status.session_id, status.phase) == ("s1", PHASE.COMPLETE)


def test_a_recording_that_goes_on_after_a_start_of_the_system_has_a_gap_whatever_is_left_of_its_first_files():
    """A power cut in flight may leave a file of 0 bytes, so nobody knows how far it went."""
    first, second = recording(), Platform()
    began_ns = first.machine.facts()["seen"]["states"]["from_ns"]
    second.machine.remember(0, recorded_memory(first), same_boot=False)
    recovered(second.go_on(0.3))
    second.now_ns += 40 * S
    second.go_on(0.1)
    assert second.start() == Answer(accepted=True)
    second.go_on(1.0)
    for name, gap in zip(("states", "cameras"), second.machine.facts()["gaps"]):
        assert (gap["group"], gap["file"], gap["ending"]) == (name, 2, "its computer was started anew")
        assert gap["from_ns"] == began_ns
        assert gap["to_ns"] - gap["from_ns"] == round(gap["seconds"] * S)
        assert EPOCH_NS + 40 * S < gap["to_ns"] <= EPOCH_NS + second.now_ns


def test_a_recorder_that_somebody_stopped_is_told_to_go_on_and_the_time_is_a_gap():
    platform = recording()
    platform.obeys["cameras"] = ("INT", "TERM", "KILL")
    platform.halted["cameras"] = True
    platform.go_on(37.9)
    assert platform.part.message == "cameras: its process was stopped: it is told to go on"
    assert Signal("cameras", "CONT") in platform.commands
    platform.obeys["cameras"] += ("CONT",)
    platform.go_on(1.0)
    (gap,) = platform.machine.facts()["gaps"]
    assert (gap["group"], gap["file"], gap["ending"], gap["inside"]) == ("cameras", 1, "its process was stopped", True)
    assert gap["seconds"] == pytest.approx(38.0, abs=0.2)
    assert gap["to_ns"] - gap["from_ns"] == round(gap["seconds"] * S)
    assert platform.part.growing
    assert len(platform.asked(StartChild)) == 2, "it is not started again"


def test_a_recorder_that_was_stopped_and_then_killed_is_one_gap():
    platform = recording()
    platform.obeys["cameras"] = ()
    platform.halted["cameras"] = True
    platform.go_on(2.0)
    platform.halted["cameras"] = False
    platform.kill("cameras")
    platform.go_on(2.0)
    (gap,) = platform.machine.facts()["gaps"]
    assert gap["seconds"] == pytest.approx(2.3, abs=0.3)


def test_a_recorder_that_is_stopped_while_the_storage_is_full_can_close_its_file():
    platform = recording()
    platform.halted["cameras"], platform.free = True, 0
    platform.turn()
    assert Signal("cameras", "CONT") in platform.commands
    assert Signal("cameras", "INT") in platform.commands


def test_a_recorder_that_is_stopped_when_the_recording_ends_is_told_to_go_on_too():
    platform = recording()
    platform.halted["cameras"] = True
    platform.stop()
    platform.turn()
    assert Signal("cameras", "CONT") in platform.commands
    assert not platform.halted["cameras"]


def test_a_process_that_was_killed_while_it_closed_or_recovered_goes_on_there():
    first, second = recording(), Platform()
    first.obeys = dict.fromkeys(first.obeys, ())
    first.stop()
    first.go_on(0.2)
    second.running = dict(first.running)
    second.machine.remember(0, recorded_memory(first), same_boot=True)
    second.go_on(0.3)
    assert second.commands == [Signal("states", "INT"), Signal("cameras", "INT"), Recover()]


def renamed(memory, running=(), **endings):
    """Return a platform that goes on from a memory, with a configuration in which cameras is called front."""
    platform = Platform(groups=("states", "cameras", "front"))
    setup = platform.machine.setup
    groups = tuple(each for each in setup.groups if each.name != "cameras")
    platform.machine = PlatformRecorder(replace(setup, groups=groups))
    platform.running.update(dict.fromkeys(running, True))
    platform.endings.update(endings)
    platform.numbers = {"states": 1, "cameras": 1, "front": 0}
    platform.now_ns = 2 * S
    platform.machine.remember(platform.now_ns, memory, same_boot=True)
    return platform


@pytest.mark.parametrize("obeys", [True, False])
def test_a_recorder_of_a_group_that_was_renamed_is_told_to_end_once_and_one_of_the_new_name_begins(obeys):
    first = recording()
    later = renamed(recorded_memory(first), ("states", "cameras"), cameras=UNWANTED)
    later.obeys["cameras"] = ("INT",) if obeys else ("TERM",)
    later.go_on(3.0)
    assert later.commands == [Signal("cameras", "INT"), StartChild("front", 1)]
    assert (later.machine.phase, later.part.growing) == (PHASE.RECORDING, True)
    later.stop()
    later.go_on(0.5)
    told = {each.name for each in later.asked(Signal) if each.group == "cameras"}
    assert later.running["cameras"] == (not obeys)
    assert (told, later.machine.phase) == ({"INT"}, PHASE.RECOVERING if obeys else PHASE.STOPPING)


@pytest.mark.parametrize("killed", [True, False])
def test_what_a_group_recorded_stays_known_when_the_session_goes_on_without_it_and_the_rest_is_a_gap(killed):
    """The node is killed while it records, or the session was stopped: then recording.yaml is another one."""
    first = recording()
    if not killed:
        stopped(first)
    later = renamed(recorded_memory(first), ("states", "cameras") if killed else (), cameras=UNWANTED)
    if not killed:
        later.turn()
        assert later.start() == Answer(accepted=True)
    later.go_on(5.0)
    assert (later.machine.phase, later.part.growing) == (PHASE.RECORDING, True)
    assert [each.group for each in later.asked(StartChild)] == (["front"] if killed else ["states", "front"])
    assert later.part.message.split("; ")[0] == f"cameras: {UNWANTED}"
    stopped(later)
    facts = later.machine.facts()
    (gap,) = [each for each in facts["gaps"] if each["group"] == "cameras"]
    assert (gap["file"], gap["ending"], gap["seconds"] > 4.5, "to_ns" in gap) == (2, UNWANTED, True, True)
    assert facts["configured"]["cameras"]["topics"] == ["/cameras"]
    assert facts["seen"]["cameras"]["file"] == 1


def test_the_rate_is_that_of_the_last_seconds():
    assert 1.9e6 < recording().go_on(3.0).part.byte_rate < 2.1e6


def test_a_part_is_removed_only_when_it_is_complete_and_parts_are_not_kept():
    platform = recording()
    not_yet = Answer(accepted=False, message="session 's1' is not complete here")
    assert platform.machine.may_remove("s1", keep=False) == not_yet
    platform.stop()
    platform.go_on(0.3)
    recovered(platform)
    assert platform.machine.may_remove("s1", keep=False) == Answer(accepted=True)
    kept = Answer(accepted=False, message="the configuration says keep_parts: true")
    assert platform.machine.may_remove("s1", keep=True) == kept
    assert not platform.machine.may_remove("s2", keep=False).accepted


def test_a_gap_says_when_it_was_by_the_clock_that_stamps_messages():
    platform = recording()
    platform.full["cameras"], platform.grows["cameras"] = True, 0
    platform.go_on(5.0)
    (gap,) = platform.machine.facts()["gaps"]
    assert (gap["from_ns"], "to_ns" in gap) == (EPOCH_NS + S, False), "it lasts"
    platform.full["cameras"], platform.grows["cameras"] = False, 2_000_000
    platform.go_on(1.0)
    (gap,) = platform.machine.facts()["gaps"]
    assert gap["to_ns"] - gap["from_ns"] == round(gap["seconds"] * S) == 5_100_000_000


def test_files_that_are_removed_in_flight_are_said_at_once_and_a_new_one_is_begun():
    platform = recording()
    platform.go_on(4.0)
    platform.removed["cameras"], platform.sizes["cameras"] = True, 0
    platform.turn()
    assert platform.part.message == "cameras: its files were removed: it begins a new one"
    assert platform.asked(Signal) == [Signal("cameras", "INT")]
    platform.go_on(1.5)
    assert platform.commands[-1] == StartChild("cameras", 2)
    assert platform.part.growing
    (gap,) = platform.machine.facts()["gaps"]
    assert (gap["ending"], gap["file"], gap["from_ns"]) == ("its files were removed", 2, EPOCH_NS + 100_000_000)
    assert gap["seconds"] >= 5.0, "all that they held is lost"


def with_groups(platform, **topics):
    """Give a machine another configuration, as the next process of its node reads it."""
    groups = tuple(GroupSetup(name, tuple(each)) for name, each in topics.items())
    platform.machine = PlatformRecorder(replace(platform.machine.setup, groups=groups))
    return platform


def test_the_list_of_a_part_says_what_its_recorders_were_told_to_record():
    platform = recording()
    listed = {"states": configured(["/states"]), "cameras": configured(["/cameras"])}
    assert platform.machine.facts()["configured"] == listed


def test_a_configuration_that_comes_later_does_not_change_what_was_recorded():
    """The folder is copied after the flight, and the node started again: its list has what its recorders were told."""
    first = stopped(recording())
    later = Platform(groups=("states", "cameras", "depth"))
    with_groups(later, states=["/states", "/more"], cameras=["/cameras"], depth=["/depth"])
    later.machine.remember(0, recorded_memory(first), same_boot=True)
    assert later.machine.facts()["configured"] == first.machine.facts()["configured"]
    assert later.start() == Answer(accepted=True)
    later.numbers = dict.fromkeys(later.numbers, 1)
    later.turn()
    told = later.machine.facts()["configured"]
    assert told == {**first.machine.facts()["configured"], "depth": configured(["/depth"])}


def test_of_a_session_of_an_earlier_version_what_is_configured_now_is_listed():
    memory = recorded_memory(stopped(recording()))
    for group in memory["groups"].values():
        del group["configured"]
    later = with_groups(Platform(), states=["/states", "/more"])
    later.machine.remember(0, memory, same_boot=True)
    assert later.machine.facts()["configured"] == {"states": configured(["/states", "/more"])}
