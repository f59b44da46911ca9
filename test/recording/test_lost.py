"""What was lost, in words."""

from replay_bags import START_NS

from amaze_autonomy.recording.losses import losses

S = 1_000_000_000
GAP = {"group": "cameras", "file": 2, "seconds": 0.42, "ending": "killed by SIGKILL"}


def test_nothing_lost_is_no_word():
    assert losses({"files": [{"file": "a", "lost": 0}], "gaps": [], "dropped": 0, "missing": {}}) == []


def test_gaps_and_dropped_messages_are_losses():
    gaps = [GAP, {**GAP, "group": "states"}, {**GAP, "missing": 1200}]
    content = {"files": [{"file": "a", "lost": 3}, {"file": "b", "lost": None}], "gaps": gaps, "dropped": 2}
    assert losses(content) == [
        "a: 3 messages",
        "b: an unknown number of messages",
        "cameras: 2 times, together 0.8 s, at least 1,200 messages, in which nothing was recorded (killed by SIGKILL)",
        "states: 0.4 s, in which nothing was recorded (killed by SIGKILL)",
        "at least 2 messages dropped (warnings of the recorder: 2, one in 5 s at most; "
        "topics without numbers are not counted)",
    ]


def test_numbers_that_are_missing_count_more_than_warnings_that_come_every_five_seconds():
    assert losses({"files": [], "dropped": 2, "missing": {"/imu": 41, "/gps": 1}}) == [
        "at least 42 messages dropped (by the numbers in headers: 1 of /gps, 41 of /imu; "
        "warnings of the recorder: 2, one in 5 s at most; topics without numbers are not counted)"
    ]
    assert losses({"files": [], "missing": {"/imu": 1}}) == [
        "at least 1 message dropped (by the numbers in headers: 1 of /imu)"
    ]


def test_the_end_of_an_open_file_is_told_by_the_gap_that_follows_it():
    entries = [
        {"file": f"cameras-0{n}.recovered.bag", "recovered_from": f"cameras-0{n}.bag.active", "lost": None}
        for n in (1, 2)
    ]
    gap = "cameras: 0.4 s, in which nothing was recorded (killed by SIGKILL)"
    content = {"files": entries, "gaps": [GAP], "open_ends": {"cameras": START_NS}}
    assert losses(content) == ["cameras-02.recovered.bag: an unknown number of messages", gap]
    assert losses(content, START_NS + S) == [gap, "cameras: up to 1.0 s at the end (its last file was not closed)"]


def test_what_was_not_closed_may_have_missed_all_until_the_end():
    content = {"files": [], "open_ends": {"cameras": START_NS}}
    assert losses(content, START_NS + 12 * S) == ["cameras: up to 12.0 s at the end (its last file was not closed)"]
    assert losses(content) == losses(content, START_NS + S // 20) == []
