"""One verified recording of all parts: everything in it, nothing twice, what is done is not done again."""

import json
import shutil

import pytest
from bag_tools import contents, digest, multiset, rows
from part_tools import FACTS, MEASURED, killed, modes, open_to_others, part, plan, small_storage, two_platforms
from replay_bags import START_NS, make, write_empty_bag

from amaze_autonomy.bags.cli import main
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.recording.errors import RecordingError, TransferError
from amaze_autonomy.recording.job import Plan, Source, collect
from amaze_autonomy.recording.parts import close_parts
from amaze_autonomy.recording.status import configured

S = 1_000_000_000


def manifest(session):
    return json.loads((session / "s1_m.manifest.json").read_text())


def test_every_message_of_all_parts_is_in_it_and_it_says_where_how_big_how_long_and_what_was_lost(tmp_path):
    session = two_platforms(tmp_path)
    summary = collect(plan(session))
    output = session / "s1_m.bag"
    assert multiset(output) == multiset(session / "main" / "states-01.bag", session / "second" / "realsense-01.bag")
    assert (summary.location, summary.size, summary.messages) == (str(output), output.stat().st_size, 900)
    size = f"{summary.size / 1e6:.1f}"
    assert summary.message == f"{size} MB, 3.3 s, 900 messages of main and second, verified; nothing was lost"
    assert manifest(session)["verified"]["ok"] is True
    assert sorted(manifest(session)["platforms"]) == ["main", "second"]


def test_it_is_not_made_again_when_it_is_there(tmp_path):
    session = two_platforms(tmp_path)
    first = collect(plan(session))
    stamp = (session / "s1_m.bag").stat().st_mtime_ns
    assert collect(plan(session)) == first
    assert (session / "s1_m.bag").stat().st_mtime_ns == stamp


def test_it_is_made_again_when_a_part_came_later(tmp_path):
    session = two_platforms(tmp_path)
    collect(plan(session))
    part(session / "main", ("states-02.bag", [rows("/a", 10, first_ms=9000)]))
    assert collect(plan(session)).messages == 910


def test_a_recording_whose_parts_are_gone_is_never_written_over(tmp_path):
    """`keep_parts: false`: its parts were removed once it was verified; then the session is recorded once more."""
    session = two_platforms(tmp_path)
    collect(plan(session))
    first = digest(session / "s1_m.bag")
    for number, count in ((2, 20), (3, 30)):
        for name in ("main", "second"):
            for path in (session / name).glob("*.bag"):
                path.unlink()
            part(session / name, (f"states-0{number}.bag", [rows("/a", count, first_ms=number * 9000)]), platform=name)
        summary = collect(plan(session))
        assert (summary.location, summary.messages) == (str(session / f"s1_m-{number}.bag"), 2 * count)
        assert collect(plan(session)) == summary, "and what is there is not made again"
    assert summary.message.endswith(
        "verified; nothing was lost; what was recorded before is in s1_m.bag and s1_m-2.bag"
    )
    assert (digest(session / "s1_m.bag"), manifest(session)["output"]["messages"]) == (first, 900)


def test_who_verifies_it_with_the_parts_that_are_left_gives_no_leave_to_write_over_it(tmp_path, capsys):
    session = two_platforms(tmp_path)
    collect(plan(session))
    output, first = session / "s1_m.bag", digest(session / "s1_m.bag")
    (session / "main" / "states-01.bag").unlink()
    assert main(["verify", str(output), str(session / "second" / "realsense-01.bag")]) == 3
    assert "problems" in capsys.readouterr().out
    part(session / "main", ("states-02.bag", [rows("/a", 20, first_ms=9000)]))
    assert collect(plan(session)).location == str(session / "s1_m-2.bag")
    assert digest(output) == first


@pytest.mark.parametrize("ok", [True, False])
def test_a_verified_recording_is_written_over_only_by_one_that_has_all_that_it_was_made_of(tmp_path, ok):
    """A platform, or a file, is there and named no more; what failed its verification has to give way."""
    session = two_platforms(tmp_path)
    collect(plan(session))
    before, path = digest(session / "s1_m.bag"), session / "s1_m.manifest.json"
    path.write_text(json.dumps({**manifest(session), "verified": {"ok": ok, "problems": [], "readers": {}}}))
    summary = collect(Plan(session / "s1_m.bag", plan(session).sources[:1]))
    assert summary.messages == 600
    assert summary.beside == (("s1_m.bag",) if ok else ())
    assert (digest(session / "s1_m.bag") == before) == ok


def test_a_manifest_that_cannot_be_read_is_no_leave_to_write_over_its_recording(tmp_path):
    session = two_platforms(tmp_path)
    collect(plan(session))
    (session / "s1_m.manifest.json").write_text("{")
    assert collect(plan(session)).location == str(session / "s1_m-2.bag")


def test_it_is_made_again_when_it_is_not_what_it_should_be(tmp_path):
    session = two_platforms(tmp_path)
    collect(plan(session))
    raw = (session / "s1_m.bag").read_bytes()
    (session / "s1_m.bag").write_bytes(raw[:-1])
    assert collect(plan(session)).messages == 900
    assert (session / "s1_m.bag").read_bytes() == raw


def test_losses_are_in_the_summary_and_in_the_manifest(tmp_path):
    session = two_platforms(tmp_path)
    killed(session / "second", "realsense-02.bag.active", rows("/c", 50, first_ms=9000), cut=20)
    gap = {"group": "realsense", "file": 2, "seconds": 1.5, "ending": "killed by SIGKILL"}
    close_parts(session / "second", {**FACTS, "platform": "second", "gaps": [gap], "dropped": 1})
    summary = collect(plan(session))
    lost = [
        "second/realsense-02.bag: an unknown number of messages",
        "second/realsense: 5.7 s, in which nothing was recorded (killed by SIGKILL)",
        "second/at least 1 message dropped (warnings of the recorder: 1, one in 5 s at most; "
        "topics without numbers are not counted)",
    ]
    assert (list(summary.lost), manifest(session)["lost"]) == (lost, lost)
    assert summary.messages == 949
    assert summary.message.endswith("verified; lost: " + "; ".join(lost))


def test_what_the_flight_lacks_is_told_apart_from_what_was_lost_on_the_ground(tmp_path):
    session = two_platforms(tmp_path)  # 300 messages of each, 10 ms apart
    seen = {"group": "realsense", "file": 2, "seconds": 1.5, "ending": "killed by SIGKILL"}
    facts = {"platform": "second", "topics": {"realsense": ["/c"]}, "gaps": [seen]}
    part(session / "second", ("realsense-02.bag", [rows("/c", 50, 11, first_ms=9000)]), **facts)
    gap = "second/realsense: 5.7 s, in which nothing was recorded (killed by SIGKILL)"
    for flights, in_flight in (
        ([[START_NS + 4 * S, START_NS + 5 * S]], (gap,)),
        ([[START_NS, START_NS + 2 * S]], ()),
        (None, (gap,)),
    ):
        summary = collect(plan(session, facts={"flights": flights}))
        assert (summary.lost, summary.lost_in_flight) == ((gap,), in_flight), flights
        assert manifest(session)["lost_in_flight"] == list(summary.lost_in_flight)
    tolerated = collect(plan(session, facts={"tolerated_topics": ["/c"]}))
    assert (tolerated.lost, tolerated.lost_in_flight) == ((gap,), ())
    assert tolerated.message.endswith(f"lost: {gap}; nothing of the flight, or it is tolerated")


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "landed_s, lost",
    [
        (5.0, ()),
        (6.9, ()),
        (9.5, ("the last 4.5 s of the flight: the recording was ended before",)),
        (None, ("the end of the flight: the recording was ended before the engine said that it was over",)),
    ],
)
def test_a_recording_that_somebody_ends_in_flight_lacks_the_rest_of_it(tmp_path, landed_s, lost):
    flight = [START_NS, None if landed_s is None else START_NS + round(landed_s * S)]
    summary = collect(plan(two_platforms(tmp_path), facts={"flights": [flight], "stopped_ns": START_NS + 5 * S}))
    assert summary.lost_in_flight == lost


def test_a_flight_whose_takeoff_nobody_saw_may_lack_its_beginning(tmp_path):
    facts = {"flights": [[0, START_NS + 2 * S]], "stopped_ns": START_NS + 2 * S}
    assert collect(plan(two_platforms(tmp_path), facts=facts)).lost_in_flight == (
        "the beginning of the flight, perhaps: the recording was begun in flight",
    )


def seen(group, from_s, to_s):
    return {"seen": {group: {"file": 1, "from_ns": START_NS + from_s * S, "to_ns": START_NS + to_s * S}}}


def test_a_platform_that_was_stopped_in_flight_and_asked_again_has_a_gap_there(tmp_path):
    """Its files were closed as they should be, 0 to 20 s and 50 to 80 s; the flight was from 10 to 70 s."""
    session = two_platforms(tmp_path, 8000)
    (session / "second" / "realsense-01.bag").unlink()
    files = [("realsense-01.bag", [rows("/c", 2000)]), ("realsense-02.bag", [rows("/c", 3000, first_ms=50_000)])]
    part(session / "second", *files, platform="second", **seen("realsense", 0, 80))
    flight = {"flights": [[START_NS + 10 * S, START_NS + 70 * S]], "stopped_ns": START_NS + 80 * S}
    summary = collect(plan(session, facts=flight))
    gap = "second/realsense: 30.0 s, in which nothing was recorded (it was stopped and started again)"
    assert summary.lost_in_flight == (gap,)


def test_a_platform_that_began_after_the_takeoff_by_its_own_clock_lacks_what_came_before(tmp_path):
    session = tmp_path / "s1_m"
    part(session / "main", ("states-01.bag", [rows("/a", 800)]), **seen("states", 0, 80))
    late = rows("/c", 400, first_ms=33_000)  # its clock is 3 s ahead: it began at 30 s
    part(session / "second", ("realsense-01.bag", [late]), platform="second", **seen("realsense", 33, 83))
    flight = {"flights": [[START_NS + 10 * S, START_NS + 70 * S]], "stopped_ns": START_NS + 80 * S}
    words = "second/realsense: the first 20.0 s of the flight: its recording was begun after the takeoff"
    for moments in (("start", "stop"), ("start",)):  # at the stop it could not be asked
        clock = {when: {"offset_ns": 3 * S, "error_ns": 1000, "at_ns": 1} for when in moments}
        sources = (
            Source("main", session / "main"),
            Source("second", session / "second", fetched=True, far=True, clock=clock),
        )
        summary = collect(Plan(session / "s1_m.bag", sources, facts=flight))
        assert summary.lost_in_flight == (words,)


def test_on_a_platform_whose_clock_nobody_measured_every_gap_may_lie_in_the_flight(tmp_path):
    """Its clock is a minute behind: 15 s of the flight are missing, and by its own times they were before it."""
    session = tmp_path / "s1_m"
    part(session / "main", ("states-01.bag", [rows("/a", 8000)]), **seen("states", 0, 80))
    files = [("realsense-01.bag", [rows("/c", 1, first_ms=1)]), ("realsense-02.bag", [rows("/c", 2, first_ms=15_000)])]
    part(session / "second", *files, platform="second")
    flight = {"flights": [[START_NS + 61 * S, START_NS + 75 * S]], "stopped_ns": START_NS + 80 * S}
    gap = "second/realsense: 15.0 s, in which nothing was recorded (it was stopped and started again)"
    again = {**MEASURED, "start-2": MEASURED["start"]}  # and by its end it may have been stepped
    start, stop = ({when: MEASURED[when]} for when in ("start", "stop"))
    for begun, clock, lost in (
        (1, {}, (gap,)), (1, start, (gap,)), (1, stop, (gap,)), (1, MEASURED, ()),
        (2, again, (gap,)), (2, {**again, "stop-2": MEASURED["stop"]}, ()),
    ):  # fmt: skip
        far = Source("second", session / "second", fetched=True, far=True, begun=begun, clock=clock)
        summary = collect(Plan(session / "s1_m.bag", (Source("main", session / "main"), far), facts=flight))
        assert (summary.lost, summary.lost_in_flight) == ((gap,), lost)


def with_clock(session, *offsets_s, **facts):
    """Collect with a second platform whose clock was so far ahead at the start and at the stop."""
    times = zip(("start", "stop"), offsets_s, (1, 80 * S))
    clock = {when: {"offset_ns": round(s * S), "error_ns": 1000, "at_ns": at_ns} for when, s, at_ns in times}
    far = Source("second", session / "second", fetched=True, far=True, clock=clock)
    return collect(Plan(session / "s1_m.bag", (Source("main", session / "main"), far), facts=facts))


@pytest.mark.parametrize("step_s", [60.0, -60.0])
def test_a_clock_that_was_stepped_while_it_recorded_hides_no_gap(tmp_path, step_s):
    """It is stepped late in the flight, in which 15 s are missing; by the mean of its offsets they were not in it."""
    session = two_platforms(tmp_path)
    (session / "second" / "realsense-01.bag").unlink()
    files = [("realsense-01.bag", [rows("/c", 2)]), ("realsense-02.bag", [rows("/c", 2, first_ms=15_010)])]
    part(session / "second", *files, platform="second")
    step = (
        "second/its clock, or the collector's, was stepped by 60.0 s during the recording: its record times are left "
        "as they are, and do not tell what was lost in the flight"
    )
    gap = "second/realsense: 15.0 s, in which nothing was recorded (it was stopped and started again)"
    facts = {"flights": [[START_NS + 2 * S, START_NS + 18 * S]], "stopped_ns": START_NS + 80 * S}
    assert with_clock(session, 0.0, 0.0, **facts).lost_in_flight == (gap,)
    summary = with_clock(session, 0.0, step_s, **facts)
    assert summary.lost == summary.lost_in_flight == (step, gap)
    assert manifest(session)["platforms"]["second"]["lost"] == [each.replace("second/", "") for each in (step, gap)]


def test_a_clock_that_was_stepped_is_said_though_every_message_is_there(tmp_path):
    summary = with_clock(two_platforms(tmp_path), 3.0, 2.5, flights=[[START_NS, START_NS + S]], tolerated_topics=["/c"])
    (step,) = summary.lost_in_flight
    assert step.startswith("second/its clock, or the collector's, was stepped by 0.5 s during the recording: ")
    assert summary.message.endswith(f"verified; lost: {step}")


def test_a_clock_that_was_set_back_over_a_restart_and_set_right_again_hides_no_gap(tmp_path):
    """20 s of the flight are missing; back without a battery for its clock, it is 60 s early until NTP comes."""
    session = two_platforms(tmp_path, count=2)
    (session / "second" / "realsense-01.bag").unlink()
    early, right = rows("/c", 50), rows("/c", 50, first_ms=65_000)
    files = [("realsense-01.bag", [rows("/c", 4000)]), ("realsense-02.bag", [early, right])]
    anew = {"group": "realsense", "file": 2, "seconds": 0.0, "ending": "its computer was started anew"}
    part(session / "second", *files, platform="second", gaps=[anew])
    facts = {"flights": [[START_NS + 10 * S, START_NS + 85 * S]], "stopped_ns": START_NS + 90 * S}
    summary = with_clock(session, 0.0, 0.0, **facts)
    lost = (
        "its clock was set back during the recording: its record times do not tell what was lost in the flight",
        "realsense: an unknown time (its clock was set back), in which nothing was recorded "
        "(its computer was started anew)",
    )
    assert summary.lost == summary.lost_in_flight == tuple(f"second/{each}" for each in lost)
    assert manifest(session)["platforms"]["second"]["lost"] == list(lost)


def test_where_the_clock_of_the_collector_was_set_back_every_gap_may_lie_in_the_flight(tmp_path):
    """100 s into the flight an hour is taken from it: who listened says so, or a flight that ends before it began."""
    session, hour_ns = two_platforms(tmp_path), 3600 * S
    full = {"group": "states", "file": 1, "inside": True, "ending": "the storage was full", "seconds": 20.0}
    times = {"from_ns": START_NS + 40 * S, "to_ns": START_NS + 60 * S}
    part(session / "main", gaps=[{**full, **times}])
    gap = "main/states: 20.0 s, in which nothing was recorded (the storage was full)"
    before, after = ([[START_NS + s * S, START_NS + s * S + 10 * S]] for s in (0, 100))
    back = (
        "the collector's clock was set back by {:,.1f} s or more during the recording: its record times are left as "
        "they are, and do not tell what was lost in the flight"
    )
    for flights, set_back_ns, lost in (
        (before, 0, ()), (after, hour_ns, (back.format(3600), gap)),
        ([[START_NS + 2 * S, START_NS + 200 * S - hour_ns]], 0, (back.format(3402), gap)),
    ):  # fmt: skip
        facts = {"flights": flights, "set_back_ns": set_back_ns, "stopped_ns": START_NS + 300 * S}
        summary = collect(plan(session, facts=facts))
        assert (gap in summary.lost, summary.lost_in_flight) == (True, lost)


def test_while_a_clock_drifts_what_may_lie_in_the_flight_counts(tmp_path):
    """Its offset was 0 s, then 0.1 s: by the mean, its gap ends 30 ms before the takeoff, at first it did not."""
    session = two_platforms(tmp_path)
    (session / "second" / "realsense-01.bag").unlink()
    files = [("realsense-01.bag", [rows("/c", 1)]), ("realsense-02.bag", [rows("/c", 1, first_ms=2020)])]
    part(session / "second", *files, platform="second")
    gap = "second/realsense: 2.0 s, in which nothing was recorded (it was stopped and started again)"
    for takeoff_s, lost in ((2.0, (gap,)), (2.05, ())):
        summary = with_clock(session, 0.0, 0.1, flights=[[START_NS + round(takeoff_s * S), START_NS + 60 * S]])
        assert (summary.lost, summary.lost_in_flight) == ((gap,), lost)


def test_a_platform_that_recorded_nothing_of_the_session_is_a_loss_of_the_flight(tmp_path):
    session = two_platforms(tmp_path)
    summary = collect(plan(session, facts={"absent": ["third"], "flights": []}))
    assert summary.lost_in_flight == ("third: its part, nothing of this session is there",)


def test_a_platform_that_was_taken_out_of_the_configuration_is_a_loss_that_says_where_its_part_lies(tmp_path):
    session = two_platforms(tmp_path)
    summary = collect(plan(session, facts={"taken_out": {"third": "/rec/s1_m/third", "fourth": ""}, "flights": []}))
    words = "its part, recording.yaml has no such platform any more"
    there = " (it lies there at /rec/s1_m/third, and amaze-bag merge joins it)"
    assert summary.lost_in_flight == (f"third: {words}{there}", f"fourth: {words}")


def test_a_platform_with_another_copy_of_the_configuration_lacks_what_the_collectors_has(tmp_path):
    """/d was added to its group on the collector's computer; the other one's folder is last week's."""
    session = two_platforms(tmp_path)
    wanted = {"realsense": configured(["/c", "/d"])}
    lost = "second: /d is not in its configuration"
    for listed, words in (({}, ()), ({"configured": {"realsense": configured(["/c"])}}, (lost,))):
        close_parts(session / "second", {**FACTS, "platform": "second", **listed})
        main, second = plan(session).sources
        asked = Plan(session / "s1_m.bag", (main, second._replace(wanted=wanted)), facts={"flights": []})
        assert collect(asked).lost_in_flight == words
        assert manifest(session)["platforms"]["second"]["lost"] == [each.replace("second: ", "") for each in words]
    tolerated = collect(asked._replace(facts={"tolerated_topics": ["/d"]}))
    assert (tolerated.lost, tolerated.lost_in_flight) == ((lost,), ())
    close_parts(session / "second", {**FACTS, "configured": {"other": configured(["/d", "/c", "/e"])}})
    assert collect(asked).lost == (), "it records more, and into another file"


def test_what_another_platform_recovered_is_in_it_although_the_undo_file_stays_there(tmp_path):
    session, there = two_platforms(tmp_path), tmp_path / "there"
    killed(there, "realsense-02.bag.active", rows("/d", 50, first_ms=9000))
    content = close_parts(there, {**FACTS, "platform": "second"})
    shutil.rmtree(session / "second")
    (session / "second").mkdir()
    for name in ["parts.json", *(entry["file"] for entry in content["files"])]:
        shutil.copy(there / name, session / "second")
    assert collect(plan(session)).messages == 650


def test_a_part_that_ends_before_the_recording_did_is_a_loss_by_the_clock_of_its_platform(tmp_path):
    session = two_platforms(tmp_path)
    (session / "second" / "realsense-01.bag").unlink()
    killed(session / "second", "realsense-01.bag.active", rows("/c", 101, first_ms=3000))  # until 4 s, 3 s ahead
    close_parts(session / "second", {**FACTS, "platform": "second"})
    clock = {"start": {"offset_ns": 3 * S, "error_ns": 1000, "at_ns": 1}}
    sources = (Source("main", session / "main"), Source("second", session / "second", fetched=True, clock=clock))
    facts = {"stopped_ns": START_NS + 5 * S}
    summary = collect(Plan(session / "s1_m.bag", sources, facts=facts))
    assert list(summary.lost) == ["second/realsense: up to 4.0 s at the end (its last file was not closed)"]


def test_clocks_that_are_three_seconds_apart_are_corrected_when_that_is_asked(tmp_path):
    session = tmp_path / "s1_m"
    part(session / "main", ("a-01.bag", [rows("/a", 100)]))
    part(session / "second", ("b-01.bag", [rows("/b", 100, first_ms=3003)]))
    apart = collect(plan(session))
    assert [topic for _, topic, _ in contents(apart.location)] == ["/a"] * 100 + ["/b"] * 100
    clock = {"start": {"offset_ns": 3 * S, "error_ns": 1000, "at_ns": 1}}
    sources = (
        Source("main", session / "main"),
        Source("second", session / "second", fetched=True, correction_ns=-3 * S, clock=clock),
    )
    together = collect(Plan(session / "s1_m.bag", sources))
    assert [topic for _, topic, _ in contents(together.location)] == ["/a", "/b"] * 100
    assert manifest(session)["platforms"]["second"]["clock"] == clock
    assert [each["offset_ns"] for each in manifest(session)["inputs"]] == [0, -3 * S]


@pytest.mark.slow_rows
@pytest.mark.parametrize("keys", [("file", "bytes", "messages", "sha256"), ("file", "bytes", "sha256")])
@pytest.mark.parametrize("measured", [True, False])
def test_the_part_of_an_own_recorder_needs_a_list_of_its_files_and_no_more(tmp_path, keys, measured):
    """Its files may have any name, and its clock may be none that anybody could measure."""
    session = two_platforms(tmp_path)
    folder = session / "second"
    (folder / "realsense-01.bag").rename(folder / "my recorder.bag")
    [entry] = json.loads((folder / "parts.json").read_text())["files"]
    own = {**{key: entry[key] for key in keys}, "file": "my recorder.bag"}
    (folder / "parts.json").write_text(json.dumps({"files": [own]}))
    main, second = plan(session).sources
    wanted = {"realsense": configured(["/c", "/d"])}
    second = second._replace(wanted=wanted, clock=second.clock if measured else {})
    flight = {"flights": [[START_NS, START_NS + S]], "stopped_ns": START_NS + 2 * S}
    summary = collect(Plan(session / "s1_m.bag", (main, second), facts=flight))
    assert (summary.messages, summary.lost) == (900, ())
    for fetched in (True, False):
        (folder / "parts.json").write_text(json.dumps({"files": [{**own, "sha256": None, "bytes": 1}]}))
        with pytest.raises(TransferError):
            collect(Plan(session / "s1_m.bag", (main, second._replace(fetched=fetched)), facts=flight))


def test_what_a_list_does_not_know_may_be_null_and_a_checksum_in_capitals(tmp_path):
    session = two_platforms(tmp_path)
    path = session / "second" / "parts.json"
    content = json.loads(path.read_text())
    content.update(dict.fromkeys(("gaps", "missing", "recorded", "open_ends", "dropped", "topics", "logs")))
    content["files"][0]["sha256"] = content["files"][0]["sha256"].upper()
    path.write_text(json.dumps(content))
    assert collect(plan(session)).message.endswith("900 messages of main and second, verified; nothing was lost")


def test_an_empty_bag_and_a_bag_without_messages_do_no_harm(tmp_path):
    session = two_platforms(tmp_path)
    write_empty_bag(session / "second" / "other-01.bag")
    (session / "second" / "more-01.bag.active").touch()
    close_parts(session / "second", FACTS)
    assert collect(plan(session)).messages == 900


def test_the_same_message_on_both_platforms_is_kept_or_dropped_as_configured(tmp_path):
    session = tmp_path / "s1_m"
    for name in ("main", "second"):
        part(session / name, (f"{name}-01.bag", [rows("/a", 50)]))
    assert collect(plan(session)).messages == 100
    (session / "s1_m.bag").unlink()
    assert collect(plan(session, duplicates="drop")).messages == 50


@pytest.mark.parametrize("duplicates", ["count", "drop"])
def test_what_one_platform_says_again_in_its_next_file_is_all_kept(tmp_path, duplicates):
    """Its recorder split the file, and was started again; the other platform has the last of it, too."""
    session = tmp_path / "s1_m"
    said = [(START_NS + each * S // 10, "/armed", make("std_msgs/msg/String", data="yes"), "/n") for each in range(60)]
    names = ("states-01_0.bag", "states-01_1.bag", "states-02.bag")
    part(session / "main", *((name, [said[20 * each : 20 * each + 20]]) for each, name in enumerate(names)))
    files = [session / "main" / name for name in names]
    part(session / "second", platform="second")
    assert (collect(plan(session, duplicates=duplicates)).messages, manifest(session)["duplicates"]["topics"]) == (
        60,
        [],
    )
    assert multiset(session / "s1_m.bag") == multiset(*files)
    part(session / "second", ("all-01.bag", [said[50:]]), platform="second")
    assert collect(plan(session, duplicates=duplicates)).messages == (60 if duplicates == "drop" else 70)
    assert [each["messages"] for each in manifest(session)["duplicates"]["topics"]] == [10]
    assert [each["origin"] for each in manifest(session)["inputs"]] == [0, 0, 0, 1]


def test_a_recording_whose_messages_an_earlier_version_dropped_is_made_again(tmp_path):
    """It took each file for a platform of its own, and its manifest says of none where it was recorded."""
    session = tmp_path / "s1_m"
    part(session / "main", *((f"states-01_{each}.bag", [rows("/a", 5, first_ms=each * 900)]) for each in range(2)))
    part(session / "second", ("b-01.bag", [rows("/b", 5)]), platform="second")
    collect(plan(session))
    old = manifest(session)
    for each in old["inputs"]:
        del each["origin"]
    (session / "s1_m.manifest.json").write_text(json.dumps(old))
    collect(plan(session))
    assert [each["origin"] for each in manifest(session)["inputs"]] == [0, 0, 1]


def test_nothing_at_all_is_no_recording(tmp_path):
    session = tmp_path / "s1_m"
    for name in ("main", "second"):
        part(session / name)
    with pytest.raises(RecordingError, match="there is no bag on any platform, nothing was recorded"):
        collect(plan(session))


def test_a_part_that_is_not_what_was_sent_is_refused(tmp_path):
    session = two_platforms(tmp_path)
    path = session / "second" / "realsense-01.bag"
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    with pytest.raises(TransferError, match="is not what was sent"):
        collect(plan(session))


def test_a_full_storage_leaves_the_parts_as_they_were_and_a_retry_works(tmp_path):
    with small_storage(tmp_path / "full", 2) as folder:
        session = two_platforms(folder, 2000)
        filling = folder / "filling"
        filling.write_bytes(bytes(shutil.disk_usage(folder).free - 100_000))
        before = [digest(path) for path in sorted(session.rglob("*-01.bag"))]
        with pytest.raises(BagError, match=r"there is no space for it.*make space and try again, nothing was changed"):
            collect(plan(session))
        assert [digest(path) for path in sorted(session.rglob("*-01.bag"))] == before
        assert not (session / "s1_m.bag").exists()
        filling.unlink()
        assert collect(plan(session)).messages == 6000


@pytest.mark.usefixtures("umask_of_nodes")
def test_a_session_is_for_its_user_and_group_and_so_is_what_is_made_again(tmp_path):
    """One bag was left open, and is closed where it lies; another one's index is damaged, it is recovered beside it."""
    session = two_platforms(tmp_path)
    killed(session / "main", "states-02.bag.active", rows("/a", 50, first_ms=9000))
    raw = (session / "second" / "realsense-01.bag").read_bytes()
    (session / "second" / "realsense-01.bag").write_bytes(raw[:-40])
    for name in ("main", "second"):
        close_parts(session / name, {**FACTS, "platform": name})
    collect(plan(session))
    expected = {
        **dict.fromkeys((".", "main", "second"), "0750"),
        **dict.fromkeys(("s1_m.bag", "s1_m.manifest.json", "main/parts.json", "main/states-01.bag"), "0640"),
        **dict.fromkeys(("main/states-02.bag", "main/states-02.bag.undo", "second/parts.json"), "0640"),
        **dict.fromkeys(("second/realsense-01.bag", "second/realsense-01.recovered.bag"), "0640"),
        "second/realsense-01.recovered.json": "0640",
    }
    assert modes(session) == expected


@pytest.mark.usefixtures("umask_of_nodes")
@pytest.mark.parametrize("umask", [0o000, 0o022], ids=oct)
def test_what_replaces_a_file_that_others_may_read_is_for_user_and_group(tmp_path, umask):
    """Made by hand before, where others may read; so is what a merge that was killed has left."""
    session = two_platforms(tmp_path)
    collect(plan(session))
    part(session / "main", ("states-02.bag", [rows("/a", 10, first_ms=9000)]))  # it is to be made again
    for name in (".s1_m.bag.part", ".s1_m.manifest.json.part", "main/.parts.json.part"):
        (session / name).write_bytes(b"left")
    open_to_others(session, umask)
    close_parts(session / "main", FACTS)
    assert collect(plan(session)).messages == 910
    found = modes(session)
    assert {name: found[name] for name in ("s1_m.bag", "s1_m.manifest.json", "main/parts.json")} == {
        "s1_m.bag": "0640", "s1_m.manifest.json": "0640", "main/parts.json": "0640",
    }  # fmt: skip
    assert [name for name in found if name.endswith(".part")] == []


def test_a_recording_whose_manifest_somebody_removed_is_not_written_over_by_less(tmp_path):
    """Its parts were removed after it was verified (`keep_parts: false`), and the session goes on."""
    session = two_platforms(tmp_path, 100)
    first = collect(plan(session))
    before = digest(first.location)
    for each in session.glob("*/*.bag"):
        each.unlink()
    (session / "s1_m.manifest.json").unlink()
    part(session / "main", ("states-02.bag", [rows("/a", 10, 10, 5000)]))
    part(session / "second", ("realsense-02.bag", [rows("/c", 10, 10, 5000)]), platform="second")
    second = collect(plan(session))
    assert (second.beside, digest(first.location)) == (("s1_m.bag",), before)
    assert second.location != first.location


def test_a_recording_that_was_not_finished_is_made_again_in_its_place(tmp_path):
    session = two_platforms(tmp_path)
    first = collect(plan(session))
    (session / "s1_m.manifest.json").unlink()
    again = collect(plan(session))
    assert (again.location, again.beside, again.messages) == (first.location, (), first.messages)


def test_a_wrong_count_in_a_bags_own_index_makes_complete_data_no_less(tmp_path):
    session = two_platforms(tmp_path, 100)
    recorded = session / "main" / "states-01.bag"
    raw = bytearray(recorded.read_bytes())
    raw[-4] ^= 0x40
    recorded.write_bytes(raw)
    close_parts(session / "main", FACTS)
    made = collect(plan(session))
    assert (made.messages, made.lost_in_flight) == (300, ())
