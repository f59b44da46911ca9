"""What was lost, in words."""

from replay_bags import START_NS

from amaze_autonomy.recording.losses import Loss, Wanted, not_configured
from amaze_autonomy.recording.losses import losses as all_losses
from amaze_autonomy.recording.status import configured

S = 1_000_000_000
GAP = {"group": "cameras", "file": 2, "seconds": 0.42, "ending": "killed by SIGKILL"}


def losses(content, end_ns=None):
    return [each.words for each in all_losses(content, Wanted(end_ns))]


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


def test_where_a_clock_may_have_been_stepped_what_was_lost_counts_whenever_it_was_by_that_clock():
    entry = {"file": "cameras-02.recovered.bag", "recovered_from": "cameras-02.bag.active", "lost": None}
    after = {**GAP, "from_ns": START_NS + 60 * S, "to_ns": START_NS + 61 * S}
    content = {"files": [entry], "gaps": [after], "open_ends": {"cameras": START_NS + 70 * S}}
    told = Wanted(end_ns=START_NS + 50 * S, flights=((START_NS, START_NS + 40 * S),))
    assert all_losses(content, told) == []
    assert all_losses(content, told._replace(sure=False)) == [
        Loss("cameras: 0.4 s, in which nothing was recorded (killed by SIGKILL)"),
        Loss("cameras: an unknown time at the end (its last file was not closed)"),
    ]


def test_where_a_clock_was_set_back_it_is_said_and_all_counts_and_nobody_knows_how_long_a_gap_was():
    """By that clock the gap lies before the takeoff, and ends before it began."""
    away = {**GAP, "seconds": None, "from_ns": START_NS + 5 * S, "to_ns": START_NS + S, "missing": 1200}
    earlier = {**GAP, "file": 1, "from_ns": START_NS, "to_ns": START_NS + S}
    content = {"files": [], "gaps": [away, away, earlier], "set_back": ["cameras"]}
    assert all_losses(content, Wanted(end_ns=START_NS + 50 * S, flights=((START_NS + 10 * S, START_NS + 40 * S),))) == [
        Loss("its clock was set back during the recording: its record times do not tell what was lost in the flight"),
        Loss(
            "cameras: 2 times, together an unknown time (its clock was set back), at least 2,400 messages, in which "
            "nothing was recorded (killed by SIGKILL)"
        ),
        Loss("cameras: 0.4 s, in which nothing was recorded (killed by SIGKILL)"),
    ]


def test_what_was_not_closed_may_have_missed_all_until_the_end():
    content = {"files": [], "open_ends": {"cameras": START_NS}}
    assert losses(content, START_NS + 12 * S) == ["cameras: up to 12.0 s at the end (its last file was not closed)"]
    assert losses(content) == losses(content, START_NS + S // 20) == []


def at(from_s, to_s, **more):
    seconds = 0.0 if to_s is None else to_s - from_s
    to_ns = {} if to_s is None else {"to_ns": round(to_s * S)}
    return {**GAP, "from_ns": round(from_s * S), **to_ns, "seconds": seconds, **more}


def counting(*gaps, flights=((10 * S, 20 * S),), **wanted):
    """Return which losses make the data incomplete."""
    wanted = Wanted(flights=flights, topics={"cameras": ["/left", "/right"]}, **wanted)
    return [each.counts for each in all_losses({"files": [], "gaps": gaps}, wanted)]


def test_a_gap_counts_when_a_part_of_it_may_lie_in_the_flight():
    assert counting(at(2, 9.9)) == counting(at(20, 30)) == [False]
    assert counting(at(9, 10.1)) == counting(at(12, 13)) == counting(at(19.9, 30)) == [True]
    assert counting(at(25, 26), flights=((10 * S, 20 * S), (24 * S, None))) == [True], "it has not landed yet"
    assert counting(at(2, None)) == counting(GAP) == [True], "nobody knows when it ended, or when it was"
    assert counting(at(2, 3), flights=None) == [True], "nobody said when it flew"
    assert counting(at(2, 3), flights=()) == [False], "it never flew"


def test_gaps_inside_and_outside_of_the_flight_are_told_apart():
    found = all_losses({"files": [], "gaps": [at(2, 3), at(12, 14)]}, Wanted(flights=((10 * S, 20 * S),)))
    words = "cameras: {} s, in which nothing was recorded (killed by SIGKILL)"
    assert found == [Loss(words.format("1.0"), counts=False), Loss(words.format("2.0"), counts=True)]


def test_what_is_tolerated_is_told_and_does_not_count():
    assert counting(at(12, 13), tolerated=frozenset({"/left"})) == [True], "the right one is missing as well"
    assert counting(at(12, 13), tolerated=frozenset({"/left", "/right"})) == [False]
    dropped = {"files": [], "missing": {"/left": 3}}
    (tolerated,) = all_losses(dropped, Wanted(tolerated=frozenset({"/left"})))
    assert tolerated == Loss("at least 3 messages dropped (by the numbers in headers: 3 of /left)", counts=False)
    (warned,) = all_losses({**dropped, "dropped": 1}, Wanted(tolerated=frozenset({"/left"})))
    assert warned.counts, "nobody knows of which topics the recorder dropped some"


def test_a_dropped_message_counts_whenever_it_was_dropped():
    assert [each.counts for each in all_losses({"files": [], "missing": {"/imu": 1}}, Wanted(flights=()))] == [True]


def test_the_end_of_an_open_file_counts_when_the_flight_was_not_over():
    content = {"files": [], "open_ends": {"cameras": 15 * S}}
    assert [each.counts for each in all_losses(content, Wanted(30 * S, ((10 * S, 20 * S),)))] == [True]
    assert [each.counts for each in all_losses(content, Wanted(30 * S, ((10 * S, 12 * S),)))] == [False]


def test_messages_lost_at_the_end_of_an_open_file_count_as_the_gap_behind_it_does():
    entry = {"file": "cameras-01.bag", "recovered_from": "cameras-01.bag.active", "lost": 4}
    for gap, counts in ((at(2, 3), False), (at(12, 13), True)):
        found = all_losses({"files": [entry], "gaps": [gap]}, Wanted(flights=((10 * S, 20 * S),)))
        assert found[0] == Loss("cameras-01.bag: 4 messages", counts)
    damaged = {"files": [{"file": "cameras-01.bag", "lost": 4}]}
    assert all_losses(damaged, Wanted(flights=()))[0].counts, "nobody knows when they were recorded"


def test_what_came_after_the_stop_was_not_to_be_recorded():
    """A platform that is killed while it stops, and comes back later, has not lost what nobody wanted."""
    words = "cameras: {} s{}, in which nothing was recorded (killed by SIGKILL)"
    assert losses({"files": [], "gaps": [at(6.0, 25.1, missing=1900)]}, 6_600_000_000) == [words.format("0.6", "")]
    assert losses({"files": [], "gaps": [at(6.7, 25.1)]}, 6_600_000_000) == []
    assert losses({"files": [], "gaps": [at(6.0, None)]}, 8 * S) == [words.format("2.0", "")]
    assert losses({"files": [], "gaps": [at(2, 3, missing=7)]}, 8 * S) == [words.format("1.0", ", at least 7 messages")]


def edges(begin_s, end_s, flights=((10 * S, 70 * S),), end_ns=80 * S, **more):
    """Return what the flight lacks of a group that was recorded from then to then."""
    span = [None if each is None else round(each * S) for each in (begin_s, end_s)]
    content = {"files": [], "recorded": {"cameras": span}, **more}
    found = all_losses(content, Wanted(end_ns, flights, frozenset({"/left"}), {"cameras": ["/left", "/right"]}))
    assert all(each.counts for each in found)
    return [each.words for each in found]


def test_a_recording_that_begins_after_the_takeoff_lacks_the_time_between():
    words = "cameras: the first 12.3 s of the flight: its recording was begun after the takeoff"
    assert edges(22.3, 80) == [words]
    assert edges(2, 80) == edges(12.0, 80) == [], "so exactly is the takeoff not known"
    assert edges(22.3, 80, flights=()) == [], "it never flew"
    assert edges(22.3, 80, flights=None) == [], "nobody said when it flew"
    assert edges(22.3, 80, flights=((0, 70 * S),)) == [], "nobody saw the takeoff: that is told for all groups at once"


def test_a_recording_that_ends_before_the_landing_or_the_stop_lacks_the_time_between():
    words = "cameras: the last {} s: its recording was ended before"
    assert edges(2, 20) == [words.format("50.0")], "it was to last until the landing"
    assert edges(2, 20, flights=((10 * S, None),)) == [words.format("60.0")], "until the stop"
    assert edges(2, 20, flights=None) == [words.format("60.0")], "nobody said when it flew"
    assert edges(2, 20, end_ns=50 * S) == [words.format("30.0")], "after the stop nothing was to be recorded"
    assert edges(2, 68) == edges(2, 72) == [], "so exactly is the landing not known"
    assert edges(2, 20, flights=()) == [], "it never flew"
    assert edges(2, 20, flights=None, end_ns=None) == [], "nobody knows"


def test_the_end_of_a_file_that_was_left_open_is_told_once():
    assert edges(2, 20, open_ends={"cameras": 20 * S}) == [
        "cameras: up to 60.0 s at the end (its last file was not closed)"
    ]


def test_a_group_of_which_there_is_nothing_is_a_loss():
    assert edges(None, None) == ["cameras: nothing of it was recorded"]
    assert edges(None, None, flights=None) == ["cameras: nothing of it was recorded"]
    assert edges(None, None, flights=()) == [], "it never flew"


def test_the_beginning_and_the_end_of_tolerated_topics_do_not_count():
    content = {"files": [], "recorded": {"cameras": [22 * S, 50 * S]}}
    wanted = Wanted(80 * S, ((10 * S, 70 * S),), frozenset({"/left"}), {"cameras": ["/left"]})
    assert [each.counts for each in all_losses(content, wanted)] == [False, False]


# --- another configuration --------------------------------------------------------------------------------------------


def not_there(wanted, *listed, tolerated=()):
    """Return what is lost of a group that is wanted, by a part whose list has these groups."""
    groups = {f"group{number}": each for number, each in enumerate(listed)}
    return not_configured({"configured": groups}, {"realsense": wanted}, frozenset(tolerated))


IMAGE, DEPTH, IMU = (f"/realsense/{name}" for name in ("image", "depth", "imu"))


def test_a_topic_that_a_platform_was_never_told_to_record_is_a_loss():
    wanted = configured([IMAGE, DEPTH, IMU])
    assert not_there(wanted, configured([IMAGE])) == [Loss(f"{DEPTH} and {IMU} are not in its configuration")]
    assert not_there(wanted, configured([IMAGE, IMU])) == [Loss(f"{DEPTH} is not in its configuration")]
    assert not_there(wanted) == [Loss(f"{IMAGE}, {DEPTH} and {IMU} are not in its configuration")]


def test_what_is_recorded_in_another_group_or_besides_is_no_loss():
    wanted = configured([IMAGE, DEPTH])
    assert not_there(wanted, configured([DEPTH, "/more"]), configured([IMAGE])) == []


def test_a_topic_that_a_platform_lacks_and_that_is_tolerated_does_not_count():
    assert not_there(configured([IMAGE, DEPTH]), configured([]), tolerated=[DEPTH]) == [
        Loss(f"{IMAGE} is not in its configuration"),
        Loss(f"{DEPTH} is not in its configuration", counts=False),
    ]


def test_expressions_are_compared_as_they_are_written():
    wanted = configured([], ["/cam/.*", "/lrf/.*"], "/cam/raw.*")
    lost = ["topics that match /cam/.* (without /cam/raw.*) are not in its configuration"]
    lost.append(lost[0].replace("/cam/.* ", "/lrf/.* "))
    assert [each.words for each in not_there(wanted, configured([]), tolerated=["/cam/left"])] == lost
    assert not_there(wanted, configured([], ["/lrf/.*"], "/cam/raw.*")) == [Loss(lost[0])]
    assert not_there(wanted, configured([], ["/lrf/.*", "/cam/.*"])) == [], "it excludes nothing"
    assert not_there(wanted, configured([], [".*"])) == [], "it records all"
    assert not_there(wanted, configured([], ["/lrf/.*", "/cam/.*"], ".*")) == [Loss(each) for each in lost]


def test_an_open_file_before_the_last_one_has_its_loss_told():
    """What the end of a group lacks is told as its end: of the last file alone."""
    files = [
        {"file": "g-01.bag", "recovered_from": "g-01.bag.active", "lost": None, "lost_inside": 0},
        {"file": "g-02.bag", "recovered_from": "g-02.bag.active", "lost": None, "lost_inside": 0},
    ]
    content = {"files": files, "gaps": [], "open_ends": {"g": START_NS}}
    end = "g: up to 0.1 s at the end (its last file was not closed)"
    assert losses(content, START_NS + S // 10) == ["g-01.bag: an unknown number of messages", end]
