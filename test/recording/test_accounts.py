"""What was not recorded, from the files alone."""

import pytest

from amaze_autonomy.recording.losses import Account, Numbers, Written, account, recorded, written

S = 1_000_000_000
IMU, GPS = ("/imu", "/driver"), ("/gps", "/driver")
UNSEEN = "its file was not closed, and nobody saw it end"
STOPPED = "it was stopped and started again"


def file(number, first_s, last_s, closed=True, split=0, group="a", **numbers):  # noqa: FBT002
    known = {IMU: numbers["imu"]} if numbers else {}
    return Written(group, number, split, closed, round(first_s * S), round(last_s * S), known)


def gap(number, seconds, ending, **more):
    return {"group": "a", "file": number, "seconds": seconds, "ending": ending, **more}


def between(from_s, to_s):
    return {"from_ns": round(from_s * S), "to_ns": round(to_s * S)}


def test_names_of_recorders_files_are_read():
    assert written("a-b-01.bag") == Written("a-b", 1)
    assert written("a-02_3.bag.active") == Written("a", 2, 3, closed=False)
    assert [written(each) for each in ("notes.bag", "a-1.bag", "a-01.recovered.bag", "a-01.bag.orig")] == [None] * 4


def test_between_two_recorders_of_a_group_there_is_a_gap_though_the_first_one_closed_its_file():
    """A platform was asked to stop, or its node was ended, and it was asked again 30 s later."""
    files = [file(2, 50, 80), file(1, 0, 20)]
    assert account(files, []) == Account([gap(2, 30.0, STOPPED, **between(20, 50))], {}, {}, [])


def test_what_was_numbered_while_it_was_stopped_is_told_with_the_gap():
    files = [file(1, 0, 20, imu=Numbers(1, 100)), file(2, 50, 80, imu=Numbers(251, 300))]
    assert account(files, []) == Account([gap(2, 30.0, STOPPED, **between(20, 50), missing=150)], {}, {}, [])


def test_a_gap_that_was_seen_lasts_from_the_last_message_to_the_next_one():
    seen = [gap(2, 0.4, "killed by SIGKILL")]
    files = [file(1, 0, 9.5, closed=False), file(2, 10, 20)]
    assert account(files, seen) == Account([gap(2, 0.5, "killed by SIGKILL", **between(9.5, 10))], {}, {}, [])
    assert seen == [gap(2, 0.4, "killed by SIGKILL")]


def test_a_gap_that_nobody_saw_is_found():
    files = [file(1, 0, 9.5, closed=False), file(2, 10, 20), file(1, 0, 20, group="b")]
    assert account(files, []) == Account([gap(2, 0.5, UNSEEN, **between(9.5, 10))], {}, {}, [])


def test_recorders_that_wrote_nothing_are_one_gap():
    empty = Written("a", 2, closed=False)
    seen = [gap(2, 0.1, "killed by SIGKILL"), gap(3, 0.1, "killed by SIGKILL")]
    files = [file(1, 0, 9, closed=False), empty, file(3, 12, 20)]
    assert account(files, seen) == Account([gap(2, 3.0, "killed by SIGKILL", **between(9, 12))], {}, {}, [])


def test_a_gap_inside_of_a_file_is_left_as_it_was_seen():
    seen = [gap(1, 4.0, "the storage was full", inside=True)]
    assert account([file(1, 0, 9), file(2, 10, 20)], seen).gaps == seen


def test_a_file_that_was_split_is_one_recording():
    files = [file(1, 0, 10, split=0, imu=Numbers(1, 100)), file(1, 11, 20, split=1, imu=Numbers(103, 200))]
    assert account(files, []) == Account([], {"/imu": 2}, {}, [])


def test_the_end_of_a_last_file_that_is_open_is_told_unless_a_gap_follows():
    files = [file(1, 0, 10), file(2, 10, 20, closed=False)]
    assert account(files, []).open_ends == {"a": 20 * S}
    assert account(files, [gap(3, 7.0, "the storage was full")]).open_ends == {}
    assert account([Written("a", 1, closed=False)], []).open_ends == {}


def test_numbers_that_are_missing_in_a_gap_are_told_with_it_and_all_others_by_topic():
    files = [
        file(1, 0, 9.5, closed=False, imu=Numbers(1, 100, missing=3)),
        file(2, 10, 20, imu=Numbers(151, 300, missing=4)),
    ]
    assert account(files, []) == Account([gap(2, 0.5, UNSEEN, **between(9.5, 10), missing=50)], {"/imu": 7}, {}, [])


def test_a_file_that_begins_before_the_last_message_of_the_one_before_proves_a_clock_that_was_set_back():
    """A computer was started anew, without a battery for its clock; nobody knows how long it was away."""
    seen_by_node = [gap(2, 0.4, "its computer was started anew"), gap(2, 1.0, "killed by SIGKILL", group="b")]
    files = [file(1, 0, 40), file(2, 5, 90), file(1, 0, 9, group="b"), file(2, 10, 90, group="b")]
    away = gap(2, None, "its computer was started anew", **between(40, 5))
    known = account(files, seen_by_node)
    assert known.gaps == [away, gap(2, 1.0, "killed by SIGKILL", group="b", **between(9, 10))]
    assert known.set_back == ["a"]
    split = [file(1, 0, 10), file(1, 3, 20, split=1)]
    assert account(split, []) == Account([], {}, {}, ["a"]), "also where a file was only split"
    for begin_s in (9.95, 10):
        assert account([file(1, 0, 10), file(1, begin_s, 20, split=1)], []).set_back == []


def test_a_gap_that_ends_before_it_began_proves_a_clock_that_was_set_back_whatever_the_files_say():
    """Its computer was away for an hour of its clock, and afterwards nobody published what the group records."""
    back = gap(2, -3598.6, "its computer was started anew", **between(3620, 21.4))
    unknown = {**back, "seconds": None}
    assert account([file(1, 0, 20), Written("a", 2)], [back]) == Account([unknown], {}, {}, ["a"])
    assert account([], [back]) == Account([unknown], {}, {}, ["a"])
    away = {**unknown, **between(20, 25)}
    assert account([file(1, 0, 20), file(2, 25, 30)], [back]) == Account([away], {}, {}, ["a"])


def seen(number, from_s, to_s):
    return {"file": number, **{key: None if s is None else s * S for key, s in (("from_ns", from_s), ("to_ns", to_s))}}


def test_a_group_is_recorded_from_its_first_message_to_its_last_one_or_as_long_as_its_recorder_was_seen():
    files = [file(1, 5, 20), file(2, 25, 30)]
    assert recorded(files, [], {"a": seen(1, 2, 40)}) == {"a": [2 * S, 40 * S]}
    assert recorded(files, [], {"a": seen(1, 9, 28)}) == {"a": [5 * S, 30 * S]}
    assert recorded(files, [], {"a": seen(None, None, None)}) == {"a": [5 * S, 30 * S]}
    assert recorded([Written("a", 1)], [], {"a": seen(1, 2, 40)}) == {"a": [2 * S, 40 * S]}, "nobody published"


def test_a_file_of_which_a_power_cut_left_no_byte_shows_nothing():
    empty = Written("a", 1, closed=False, empty=True)
    assert recorded([empty], [], {"a": seen(1, 2, None)}) == {"a": [None, None]}
    assert recorded([empty, file(2, 25, 30)], [], {"a": seen(1, 2, 40)}) == {"a": [25 * S, 40 * S]}


@pytest.mark.parametrize("empty", [Written("a", 1, 1, empty=True), Written("a", 2, empty=True)])
def test_of_a_last_file_of_which_there_is_no_byte_all_is_missing_though_it_was_closed(empty):
    """A power cut came when the recorder had closed it, and before the disk had it."""
    files = [empty, file(1, 0, 3)]
    assert account(files, []).open_ends == {"a": 3 * S}
    assert recorded(files, [], {"a": seen(1, 0, 60)}) == {"a": [0, 3 * S]}
    seen_before = [gap(2, 0.3, "killed by SIGKILL", **between(3, 3.3))]
    assert account(files, seen_before).open_ends == ({"a": 3 * S} if empty.number == 2 else {})


def test_a_file_that_was_split_and_is_not_there_is_a_gap():
    files = [file(1, 0, 10, split=0), file(1, 20, 30, split=2)]
    (found,) = account(files, []).gaps
    assert (found["seconds"], found["ending"]) == (10.0, "a file in between is not there")
    assert recorded(files[1:], [], {"a": seen(1, 0, 40)}) == {"a": [20 * S, 40 * S]}, "nor does it show the beginning"


def test_who_saw_a_recorder_does_not_count_when_its_file_is_not_there():
    assert recorded([file(2, 25, 30)], [], {"a": seen(1, 2, 40)}) == {"a": [25 * S, 40 * S]}
    assert recorded([], [], {"a": seen(1, 2, 40)}) == {"a": [None, None]}


def test_a_gap_that_is_noted_is_no_end_and_no_beginning():
    gaps = [gap(2, 7, "x", **between(3, 10)), gap(3, 10, "x", **between(20, 30)), gap(2, 99, "x", group="b")]
    assert recorded([file(2, 10, 20)], gaps, {"a": seen(1, 1, None)}) == {"a": [3 * S, 30 * S]}


def test_of_a_group_that_nobody_watched_it_is_not_known():
    assert recorded([file(1, 5, 20)], [], {}) == {}
