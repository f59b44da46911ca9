"""The folder of a run: what earlier runs left is kept, and an unfinished one is found."""

from __future__ import annotations

import gc
import json
import os
import shutil
import threading
import time
from dataclasses import replace
from datetime import datetime, timezone
from types import SimpleNamespace
from unittest.mock import Mock, patch

import pytest

pytest.importorskip("rospy")

from launched import launched

from amaze_autonomy.engine.events import EngineStarted, Landed, LandedStatus, Tick
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.journal import journal as codec
from amaze_autonomy.nodes.autonomy import journal_file, run_folder
from amaze_autonomy.nodes.autonomy import node as engine_node
from amaze_autonomy.nodes.autonomy.run_folder import Place
from amaze_autonomy.ros.errors import StartError

EVENTS = [EngineStarted(t_ns=5), Tick(t_ns=9)]


def write_journal(folder, boot_id=None, more="", place=None, **facts):
    told = {**(place or Place(str(folder))).facts(), **facts}
    header = codec.make_header(Rules(), {}, "hash", boot_id=boot_id or run_folder.boot_id(), **told)
    text = "".join(line + "\n" for line in [codec.encode_header(header), *map(codec.encode_event, EVENTS)])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "journal.jsonl").write_text(text + more)


def found_in(place):
    """Return what an engine that is started there goes on with; nobody holds it then."""
    found = run_folder.find_unfinished(place)
    if found is not None:
        found.journal.close()
    return found


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    return tmp_path / "amaze_autonomy"


def test_a_run_without_a_folder_gets_a_new_one_of_its_label(home):
    assert run_folder.make_folder(Place(), "20261121T101500") == home / "20261121T101500"
    assert run_folder.make_folder(Place(), "20261121T101500") == home / "20261121T101500-2"


def test_a_named_folder_is_made(tmp_path):
    assert run_folder.make_folder(Place(str(tmp_path / "a" / "b")), "label") == tmp_path / "a" / "b"


def test_what_an_earlier_run_left_in_a_named_folder_is_kept(tmp_path):
    for number in ("first", "second"):
        (tmp_path / "journal.jsonl").write_text(number)
        (tmp_path / "result.json").write_text(number)
        run_folder.make_folder(Place(str(tmp_path)), "label")
    assert (tmp_path / "earlier" / "journal.jsonl").read_text() == "first"
    assert (tmp_path / "earlier-2" / "result.json").read_text() == "second"
    assert not (tmp_path / "journal.jsonl").exists()


@pytest.mark.usefixtures("home")
def test_the_journal_of_a_session_is_found_where_the_next_run_moved_it_and_that_of_the_next_run_is_not_taken_for_it(
    tmp_path,
):
    place, place_of = Place(str(tmp_path / "out")), {}
    for label, later in (("a", ""), ("b", "c"), ("d", "")):  # the engine of c goes on with the run of b
        folder = run_folder.make_folder(place, label)
        write_journal(folder, label=label)
        run_folder.register(label, folder / "journal.jsonl", also=later)
    for label in "abcd":
        place_of[label] = run_folder.registered(f"{label}-001")
    there = {"a": "earlier", "b": "earlier-2", "c": "earlier-2", "d": ""}
    assert place_of == {label: tmp_path / "out" / name / "journal.jsonl" for label, name in there.items()}
    shutil.rmtree(tmp_path / "out" / "earlier-2")
    write_journal(tmp_path / "out" / "earlier-2", label="another")
    assert [run_folder.registered(f"{label}-001") for label in "bc"] == [None, None]


@pytest.mark.usefixtures("home")
@pytest.mark.parametrize("resumed", [False, True])
def test_an_engine_that_goes_on_with_a_run_names_its_journal_for_the_sessions_of_both(tmp_path, resumed):
    write_journal(tmp_path, label="a" if resumed else "b")
    node = SimpleNamespace(
        _label="b",
        _resumed=SimpleNamespace(header={"label": "a"}) if resumed else None,
        _journal=SimpleNamespace(path=tmp_path / "journal.jsonl"),
    )
    node._run_label = lambda: engine_node.AutonomyNode._run_label(node)
    engine_node.AutonomyNode._name_journal(node)
    found = [run_folder.registered(f"{label}-001") for label in "ab"]
    assert found == [tmp_path / "journal.jsonl" if resumed else None, tmp_path / "journal.jsonl"]


@pytest.mark.usefixtures("home")
def test_a_copy_of_a_journal_that_makes_room_does_not_take_the_place_of_the_original(tmp_path):
    for name in ("original", "copy"):
        write_journal(tmp_path / name, label="a")
    run_folder.register("a", tmp_path / "original" / "journal.jsonl")
    run_folder.make_folder(Place(str(tmp_path / "copy")), "b")
    assert run_folder.registered("a-001") == tmp_path / "original" / "journal.jsonl"


@pytest.mark.usefixtures("umask_of_nodes")
def test_folders_of_runs_and_results_are_for_user_and_group(home):
    named = home / "named" / "run"
    for _ in range(2):
        folders = [run_folder.make_folder(Place(str(named)), "label"), run_folder.make_folder(Place(), "label")]
        for folder in folders:
            journal_file.create(folder, '{"kind":"header"}', Place().elsewhere).close()
            run_folder.write_result(folder, {"in_flight": False})
    run_folder.register("label", named / "journal.jsonl")
    (removed,) = Place().elsewhere()
    found = {each for each in home.rglob("*") if not each.is_symlink()}
    assert {oct(each.stat().st_mode & 0o777) for each in (home, *found) if each.is_dir()} == {"0o750"}
    assert {oct(each.stat().st_mode & 0o777) for each in found if each.is_file()} == {"0o640"}
    assert found >= {named / "earlier" / "journal.jsonl", named / "result.json", home / "journals", removed}


@pytest.mark.usefixtures("home")
def test_two_engines_of_one_second_have_sessions_and_journals_of_their_own(tmp_path):
    now = datetime(2026, 11, 27, 6, 51, 51, 999_000, tzinfo=timezone.utc)
    labels = [run_folder.own_label(now) for _ in range(3)]
    assert labels == ["20261127T065151", "20261127T065152", "20261127T065153"]
    assert run_folder.registered(f"{labels[0]}-001") is None, "its journal is not there yet"
    for label in labels[:2]:
        (tmp_path / label).mkdir()
        write_journal(tmp_path / label, label=label)
        run_folder.register(label, tmp_path / label / "journal.jsonl")
    found = [run_folder.registered(f"{label}-001") for label in labels]
    assert found == [tmp_path / label / "journal.jsonl" for label in labels[:2]] + [None]
    assert run_folder.own_label(now) == "20261127T065154"


@pytest.mark.parametrize("file", ["", "journals"])
def test_where_nothing_can_be_registered_the_label_is_the_time(home, file):
    (home / file).parent.mkdir(exist_ok=True)
    (home / file).write_text("no folder")
    assert run_folder.own_label(datetime(2026, 11, 27, tzinfo=timezone.utc)) == "20261127T000000"


def test_a_folder_that_cannot_be_made_is_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StartError, match="name another one with --output"):
        run_folder.make_folder(Place(str(tmp_path / "file" / "folder")), "label")


def test_a_journal_without_an_end_is_found_with_its_events(tmp_path):
    write_journal(tmp_path, more='{"half')
    found = found_in(Place(str(tmp_path)))
    assert (found.path, found.events, found.last_ns) == (tmp_path / "journal.jsonl", EVENTS, 9)
    assert found.header["hash"] == "hash"


@pytest.mark.parametrize("ago_s", [3600, -3600])
def test_how_long_nobody_wrote_it_is_told_by_the_wall_clock_whatever_was_done_to_that(tmp_path, ago_s):
    write_journal(tmp_path)
    os.utime(tmp_path / "journal.jsonl", (time.time() - ago_s,) * 2)
    assert found_in(Place(str(tmp_path))).away_ns == pytest.approx(3600 * 10**9, abs=60 * 10**9)


def test_a_run_that_ended_is_not_unfinished(tmp_path):
    write_journal(tmp_path)
    run_folder.write_result(tmp_path, {"in_flight": False})
    assert found_in(Place(str(tmp_path))) is None


def test_a_run_that_was_ended_in_flight_is(tmp_path):
    write_journal(tmp_path)
    run_folder.write_result(tmp_path, {"in_flight": True})
    assert found_in(Place(str(tmp_path))) is not None


def test_a_journal_of_another_boot_is_no_use(tmp_path):
    write_journal(tmp_path, boot_id="another")
    assert found_in(Place(str(tmp_path))) is None


def test_without_a_named_folder_the_newest_run_counts(home):
    for number, name in enumerate(("b", "a")):
        write_journal(home / name, place=Place())
        os.utime(home / name / "journal.jsonl", (number, number))
    assert found_in(Place()).path == home / "a" / "journal.jsonl"
    run_folder.write_result(home / "a", {"in_flight": False})
    assert found_in(Place()) is None, "an older run is not the one that was interrupted"


def dated(folder, second, **facts):
    """Write the journal of a run, with a date."""
    write_journal(folder, place=Place(), **facts)
    os.utime(folder / "journal.jsonl", (second, second))


def test_a_run_of_another_boot_with_a_later_date_hides_none_of_this_one(home):
    dated(home / "yesterday", 2000, boot_id="another")
    dated(home / "now", 1000)
    assert found_in(Place()).path == home / "now" / "journal.jsonl"


@pytest.mark.parametrize("in_flight", [False, True])
def test_of_runs_of_one_boot_the_last_word_counts_whatever_the_wall_clock_said(home, in_flight):
    dated(home / "first", 2000, clock=run_folder.BOOT_CLOCK)
    dated(home / "last", 1000, clock=run_folder.BOOT_CLOCK, more=codec.encode_event(Tick(t_ns=10)) + '\n{"half')
    run_folder.write_result(home / "first", {"in_flight": not in_flight})
    run_folder.write_result(home / "last", {"in_flight": in_flight})
    found = found_in(Place())
    assert (None if found is None else found.path) == (home / "last" / "journal.jsonl" if in_flight else None)


@pytest.mark.parametrize("size", [100_000, 300_000])
def test_a_run_whose_last_lines_are_delta_lines_is_gone_on_with_after_one_that_ended(home, monkeypatch, size):
    """Each kind of status stands in full once a minute, and all at one moment where an engine was started again."""
    monkeypatch.setattr(codec, "_MOST_DELTAS", size)  # no matter how many: none stands in full again
    encoder, text = codec.DeltaEncoder(), ""
    for number in range(size // 20):
        text += encoder.encode(LandedStatus(t_ns=10 + number, landed=Landed.AIRBORNE, distance_m=number / 8)) + "\n"
    assert "t_ns" not in text[-size:]
    dated(home / "ended", 2000, clock=run_folder.BOOT_CLOCK)
    dated(home / "last", 1000, clock=run_folder.BOOT_CLOCK, more=text)
    run_folder.write_result(home / "ended", {"in_flight": False})
    assert found_in(Place()).path == home / "last" / "journal.jsonl"


@pytest.mark.parametrize("text", ["", '{"half', "nonsense\n" * 30_000])
def test_a_journal_in_which_no_line_says_a_time_has_no_last_word(tmp_path, text):
    (tmp_path / "journal.jsonl").write_text(text)
    assert run_folder._last_ns(tmp_path / "journal.jsonl") == -1


def test_a_journal_of_another_clock_has_no_last_word(home):
    dated(home / "first", 2000, clock="ROS time")
    dated(home / "last", 1000, clock=run_folder.BOOT_CLOCK, more=codec.encode_event(Tick(t_ns=10)) + "\n")
    assert found_in(Place()).path == home / "first" / "journal.jsonl"


@pytest.mark.parametrize("newest", [False, True])
def test_a_journal_that_cannot_be_read_stops_a_start_only_as_the_newest(home, newest):
    dated(home / "now", 1000)
    dated(home / "torn", 1001 if newest else 999)
    (home / "torn" / "journal.jsonl").write_bytes(b"\0" * 100)
    os.utime(home / "torn" / "journal.jsonl", (1001 if newest else 999,) * 2)
    if newest:
        with pytest.raises(StartError, match="cannot be read"):
            found_in(Place())
    else:
        assert found_in(Place()).path == home / "now" / "journal.jsonl"


def test_a_simulated_run_that_did_not_end_is_none_that_a_flight_goes_on_with(home):
    simulated = Place(runs=str(home / "simulated"))
    folder = run_folder.make_folder(simulated, "a")
    assert folder == home / "simulated" / "a"
    write_journal(folder, place=simulated)
    assert found_in(simulated).path == folder / "journal.jsonl"
    assert found_in(Place()) is None


# --- a run whose folder is removed ------------------------------------------------------------------------------------


class Run:
    """A journal that is written in a place; `removed`: its folder goes in flight, and what was written goes on."""

    def __init__(self, place):
        self.place = place
        self.folder = run_folder.make_folder(place, "run")
        header = codec.make_header(Rules(), {}, "hash", boot_id=run_folder.boot_id(), **place.facts())
        self.journal = journal_file.create(self.folder, codec.encode_header(header), place.elsewhere)
        for event in EVENTS:
            self.journal.append(codec.encode_event(event))
        self.journal.flush()

    def removed(self, remove=lambda folder: shutil.rmtree(folder)):
        remove(self.folder)
        assert self.journal.follow(), self.journal.problem
        self.journal.close()  # as a kill: there is no result
        return self.journal.path.parent


@pytest.fixture
def simulated(home):
    return Place(runs=str(home / "simulated"))


def test_a_simulated_run_whose_folder_is_removed_never_goes_on_among_the_flights(home, simulated):
    folder = Run(simulated).removed()
    assert folder.parent == home / "simulated"
    assert found_in(Place()) is None
    assert found_in(simulated).path == folder / "journal.jsonl"
    assert found_in(simulated).events == EVENTS


def test_a_run_whose_named_folder_is_removed_goes_on_there_and_is_found_there(tmp_path, home):
    place = Place(str(tmp_path / "out"))
    assert Run(place).removed() == tmp_path / "out"
    assert found_in(place).events == EVENTS
    assert not home.exists(), "nothing lies among the runs"


def occupied(folder):
    (folder / "journal.jsonl").unlink()
    write_journal(folder, place=Place(str(folder), node="/another"))


def forbidden(folder):
    shutil.rmtree(folder)
    folder.write_text("a file in its place")


@pytest.mark.parametrize("remove", [occupied, forbidden])
@pytest.mark.parametrize("where", ["", "simulated"])
def test_where_the_named_folder_cannot_be_had_again_the_run_is_found_among_its_runs(tmp_path, home, remove, where):
    place = Place(str(tmp_path / "out"), str(home / where) if where else "", "/autonomy")
    folder = Run(place).removed(remove)
    assert folder.parent == home / where
    assert folder.name.startswith("removed-")
    assert found_in(place).path == folder / "journal.jsonl"
    for other in (
        replace(place, output=""),
        replace(place, output=str(tmp_path / "other")),
        replace(place, runs="" if where else str(home / "simulated")),
        replace(place, node="/uav2/autonomy"),
    ):
        assert found_in(other) is None, other


def test_a_simulated_run_in_a_named_folder_is_none_that_a_flight_in_it_goes_on_with(tmp_path, simulated):
    in_it = replace(simulated, output=str(tmp_path / "out"))
    Run(in_it).journal.close()
    assert found_in(Place(str(tmp_path / "out"))) is None
    assert found_in(in_it).events == EVENTS


def test_a_journal_that_does_not_say_whose_it_is_is_not_taken_up(tmp_path, home):
    for folder in (tmp_path / "out", home / "removed-1"):
        write_journal(folder, place=Mock(facts=dict))
    assert found_in(Place(str(tmp_path / "out"))) is None
    assert found_in(Place()) is None


def test_what_another_engine_of_this_computer_left_is_not_taken_up(home):
    for number, node in enumerate(("/uav1/autonomy", "/uav2/autonomy")):
        write_journal(home / node[1:5], place=Place(node=node))
        os.utime(home / node[1:5] / "journal.jsonl", (number, number))
    assert found_in(Place(node="/uav1/autonomy")).path == home / "uav1" / "journal.jsonl"
    assert found_in(Place(node="/uav2/autonomy")).path == home / "uav2" / "journal.jsonl"
    assert found_in(Place(node="/uav3/autonomy")) is None


def test_a_run_that_went_on_elsewhere_and_has_ended_is_not_unfinished(tmp_path):
    place = Place(str(tmp_path / "out"))
    folder = Run(place).removed(forbidden)
    run_folder.write_result(folder, {"in_flight": False})
    assert found_in(place) is None


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "given, runs, recordings",
    [
        ((), "", ""),
        (("output:=/data/run",), "", ""),
        (("runs:=/data/it's",), "/data/it's", ""),
        (("simulation:=true", "runs:=/data/flights"), "simulated", "simulated/recordings/main"),
        (("simulation:=true",), "simulated", "simulated/recordings/main"),
        (("simulation:=true", "output:=/data/run"), "simulated", "/data/run/recordings/main"),
        (("simulation:=true", "recordings:=/data/all"), "simulated", "/data/all/main"),
    ],
)
def test_what_is_simulated_never_lies_among_the_flights(given, runs, recordings, tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    _, words = launched("autonomy.launch", *given)
    home = tmp_path / "amaze_autonomy"
    assert words["autonomy"]["runs"] == (str(home / runs) if runs else "")
    assert words["data_recorder_main"]["folder"] == (str(home / recordings) if recordings else "")


@pytest.mark.usefixtures("home")
def test_where_nothing_is_nothing_is_found(tmp_path):
    assert found_in(Place()) is None
    assert found_in(Place(str(tmp_path / "nowhere"))) is None


def test_a_damaged_journal_is_said(tmp_path):
    write_journal(tmp_path, more="nonsense\n")
    with pytest.raises(StartError, match="cannot be read: line 4: not JSON"):
        found_in(Place(str(tmp_path)))


def test_the_result_is_whole_or_not_there(tmp_path):
    run_folder.write_result(tmp_path, {"b": 1, "a": "x"})
    assert json.loads((tmp_path / "result.json").read_text()) == {"a": "x", "b": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


# --- what an engine that is started goes on with ----------------------------------------------------------------------


def started(place, *, simulated_time=False, configuration_hash="hash"):
    """Return what the node goes on with, and what it says of it."""
    said = []
    parameters = SimpleNamespace(resume=True, output=place.output, runs=place.runs)
    with patch.multiple(
        engine_node.rospy, get_name=lambda: place.node, logwarn=said.append, logerr=said.append
    ), patch.object(engine_node.rospy.rostime, "is_wallclock", lambda: not simulated_time):
        found = engine_node._unfinished(parameters, SimpleNamespace(hash=configuration_hash))
    if found is not None:
        found.journal.close()
    return found, said


@pytest.mark.parametrize("simulated_time", [False, True])
def test_an_engine_goes_on_only_with_a_journal_on_its_own_clock(tmp_path, simulated_time):
    """The times of the other are of another world: no limit would ever pass, or all at once."""
    clocks = ["ROS time", run_folder.BOOT_CLOCK]
    place = Place(str(tmp_path))
    for clock in clocks if simulated_time else reversed(clocks):
        write_journal(tmp_path, clock=clock)
        found, said = started(place, simulated_time=simulated_time)
        own = clock == ("ROS time" if simulated_time else run_folder.BOOT_CLOCK)
        assert (found is not None, len(said)) == (own, 0 if own else 1)
    assert said == [f"{tmp_path}/journal.jsonl has not ended, but is on another clock ({clock}): a new one begins"]


def test_an_engine_does_not_go_on_with_what_was_decided_by_another_configuration(tmp_path):
    write_journal(tmp_path, clock=run_folder.BOOT_CLOCK)
    assert started(Place(str(tmp_path)), configuration_hash="other") == (
        None,
        [f"{tmp_path}/journal.jsonl has not ended, but was decided by another configuration: a new one begins"],
    )


def test_an_engine_that_cannot_read_its_journal_begins_a_new_one_and_leaves_it_as_it_is(tmp_path):
    write_journal(tmp_path, clock=run_folder.BOOT_CLOCK, more='nonsense\n{"half')
    before = (tmp_path / "journal.jsonl").read_bytes()
    found, (said,) = started(Place(str(tmp_path)))
    assert found is None
    assert "cannot be read: line 4: not JSON" in said
    assert (tmp_path / "journal.jsonl").read_bytes() == before


class StillAtIt:
    """The engine before, which the master has ended: it writes for a moment more, then lets go."""

    def __init__(self, folder, finish):
        self._path = folder / "journal.jsonl"
        self._descriptor, self._finish = journal_file.open_locked(self._path), finish
        self.thread = threading.Timer(0.3, self._end)
        self.thread.start()

    def _end(self):
        with self._path.open("a") as file:
            file.write(codec.encode_event(Tick(t_ns=11)) + "\n")
        self._finish()
        os.close(self._descriptor)


def test_what_the_engine_before_still_writes_is_gone_on_with(tmp_path):
    write_journal(tmp_path, clock=run_folder.BOOT_CLOCK)
    before = StillAtIt(tmp_path, lambda: run_folder.write_result(tmp_path, {"in_flight": True}))
    found, said = started(Place(str(tmp_path)))
    before.thread.join(10.0)
    assert (found.events, found.journal.lines, said) == ([*EVENTS, Tick(t_ns=11)], 4, [])


def test_an_engine_before_that_ends_meanwhile_on_the_ground_has_ended(tmp_path):
    write_journal(tmp_path, clock=run_folder.BOOT_CLOCK)
    before = StillAtIt(tmp_path, lambda: run_folder.write_result(tmp_path, {"in_flight": False}))
    assert started(Place(str(tmp_path))) == (None, [])
    before.thread.join(10.0)
    os.close(journal_file.open_locked(tmp_path / "journal.jsonl"))


@pytest.fixture(params=[True, False])
def looked_for_before(request):
    before = gc.isenabled()
    (gc.enable if request.param else gc.disable)()
    yield request.param
    (gc.enable if before else gc.disable)()


def test_a_journal_is_read_without_a_look_for_garbage(tmp_path, monkeypatch, looked_for_before):
    looked_for, read = [], codec.read
    monkeypatch.setattr(codec, "read", lambda text: looked_for.append(gc.isenabled()) or read(text))
    for more in ("", "nonsense\n"):
        write_journal(tmp_path, clock=run_folder.BOOT_CLOCK, more=more)
        started(Place(str(tmp_path)))
        assert gc.isenabled() == looked_for_before
    assert looked_for == [False, False]


def test_beside_an_engine_that_still_runs_none_is_started(tmp_path, monkeypatch):
    write_journal(tmp_path, clock=run_folder.BOOT_CLOCK)
    descriptor = journal_file.open_locked(tmp_path / "journal.jsonl")
    monkeypatch.setattr(journal_file._lock, "__defaults__", (0.1,))
    with pytest.raises(StartError, match="is written by another node that still runs: end it first"):
        started(Place(str(tmp_path)))
    os.close(descriptor)


def test_a_journal_is_held_until_its_engine_has_written_its_result(home):
    """Who waits for it finds the result, too."""
    run = Run(Place())
    run.journal.finish()
    with pytest.raises(StartError, match="still runs"):
        journal_file._lock(os.open(run.journal.path, os.O_RDWR), run.journal.path, 0.1)
    run.journal.close()
    assert found_in(Place()).path.parent.parent == home
