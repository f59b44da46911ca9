"""What was not recorded, from the files alone."""

from amaze_autonomy.recording.losses import Account, Numbers, Written, account, written

S = 1_000_000_000
IMU, GPS = ("/imu", "/driver"), ("/gps", "/driver")
UNSEEN = "its file was not closed, and nobody saw it end"


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


def test_files_that_were_closed_one_after_the_other_have_no_gap():
    assert account([file(2, 20, 30), file(1, 0, 10)], []) == Account([], {}, {})


def test_a_gap_that_was_seen_lasts_from_the_last_message_to_the_next_one():
    seen = [gap(2, 0.4, "killed by SIGKILL")]
    files = [file(1, 0, 9.5, closed=False), file(2, 10, 20)]
    assert account(files, seen) == Account([gap(2, 0.5, "killed by SIGKILL", **between(9.5, 10))], {}, {})
    assert seen == [gap(2, 0.4, "killed by SIGKILL")]


def test_a_gap_that_nobody_saw_is_found():
    files = [file(1, 0, 9.5, closed=False), file(2, 10, 20), file(1, 0, 20, group="b")]
    assert account(files, []) == Account([gap(2, 0.5, UNSEEN, **between(9.5, 10))], {}, {})


def test_recorders_that_wrote_nothing_are_one_gap():
    empty = Written("a", 2, closed=False)
    seen = [gap(2, 0.1, "killed by SIGKILL"), gap(3, 0.1, "killed by SIGKILL")]
    files = [file(1, 0, 9, closed=False), empty, file(3, 12, 20)]
    assert account(files, seen) == Account([gap(2, 3.0, "killed by SIGKILL", **between(9, 12))], {}, {})


def test_a_gap_inside_of_a_file_is_left_as_it_was_seen():
    seen = [gap(1, 4.0, "the storage was full", inside=True)]
    assert account([file(1, 0, 9), file(2, 10, 20)], seen).gaps == seen


def test_a_file_that_was_split_is_one_recording():
    files = [file(1, 0, 10, split=0, imu=Numbers(1, 100)), file(1, 11, 20, split=1, imu=Numbers(103, 200))]
    assert account(files, []) == Account([], {"/imu": 2}, {})


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
    assert account(files, []) == Account([gap(2, 0.5, UNSEEN, **between(9.5, 10), missing=50)], {"/imu": 7}, {})
