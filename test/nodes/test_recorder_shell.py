"""The recorder's shell without a master: statuses over the wire, what the master says, and what may be removed."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import pytest
from waiting import wait_for

pytest.importorskip("rospy")
sys.path.append(str(Path(__file__).parents[1] / "replay"))

from replay_bags import flight_rows, write_bag

from amaze_autonomy import msg
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.config.schemas.recording import Storage, TopicGroup, Transfer
from amaze_autonomy.engine.events import EngineStarted, RecordingPhase, Shutdown
from amaze_autonomy.journal.journal import encode_event, encode_header, make_header
from amaze_autonomy.nodes.autonomy.journal_file import create
from amaze_autonomy.nodes.autonomy.run_folder import Place, make_folder, register, registered
from amaze_autonomy.nodes.recorder import node as recorder_node
from amaze_autonomy.nodes.recorder import processes
from amaze_autonomy.nodes.recorder.collector import Collection, RecorderCollector, read_status
from amaze_autonomy.nodes.recorder.flight_pages import FlightPages
from amaze_autonomy.nodes.recorder.node import (
    AbsentPlatform,
    DataRecorderNode,
    RecorderLock,
    RecorderMemory,
    make_recorder,
    recording_status,
)
from amaze_autonomy.nodes.recorder.platform import CpuLoad, RecorderPlatform, processor_ticks
from amaze_autonomy.nodes.recorder.processes import DiskSync, Subscriptions
from amaze_autonomy.nodes.recorder.settings import RecorderShare, collector_setup, platform_setup, recordings_folder
from amaze_autonomy.paths import config_folder
from amaze_autonomy.recording import PlatformRecorder, PlatformSetup
from amaze_autonomy.recording.status import Answer, Ask, PlatformStatus, ProcessStatus, Status
from amaze_autonomy.recording.status import Transfer as Transfers
from amaze_autonomy.ros.errors import StartError

PART = PlatformStatus("second", True, 1000, 20.0, 0.25, "/rec/s/second", "wörds", 3, 0.5)


def over_the_wire(message):
    buffer = BytesIO()
    message.serialize(buffer)
    return type(message)().deserialize(buffer.getvalue())


@pytest.mark.parametrize(
    "status",
    [
        Status(),
        Status("s1", RecordingPhase.MERGING, 0.5, 12.0, (PART,), "/rec/s", "message"),
        Status("s1", RecordingPhase.COMPLETE, 1.0, None, (), "/rec/s.bag", "1 MB", "second: 3 s"),
        Status("s1", RecordingPhase.FAILED, None, None, (PlatformStatus("main"),), "", "missing"),
    ],
)
def test_a_status_comes_in_as_it_went_out(status):
    assert read_status(over_the_wire(recording_status(status, 5_000_000_001))) == status


def test_rates_free_space_and_load_are_published_without_noise():
    noisy = PlatformStatus("main", True, 1000, 145368.76952339258, 0.25045087642547037, cpu_fraction=0.333333333)
    (part,) = recording_status(Status("s1", RecordingPhase.RECORDING, platforms=(noisy,)), 0).platforms
    assert (part.byte_rate, part.free_fraction, part.cpu_fraction) == (145369.0, 0.2505, 0.33)


def test_the_load_is_the_part_of_each_second_of_all_cores_in_which_they_worked():
    ticks = iter([(1000, 5000), (1100, 5100), (1150, 5200), (1150, 5399), (1200, 5500), (1199, 5500)])
    load = CpuLoad(lambda: next(ticks), 200)
    assert [load.look() for _ in range(6)] == [None, None, 0.75, 0.75, 1 / 6, 1 / 6]


def test_the_load_of_this_computer_is_known_when_time_has_passed_and_unknown_where_nobody_says():
    worked, passed = processor_ticks()
    assert 0 < worked < passed
    load = CpuLoad(second=1)
    while load.look() is None:  # until the next tick of the kernel
        pass
    assert 0.0 <= load.look() <= 1.0

    def silent():
        raise FileNotFoundError

    assert CpuLoad(silent, 1).look() is None


def test_a_status_with_an_unknown_phase_is_none():
    assert read_status(msg.RecordingStatus(phase=99)) is None


def test_what_is_subscribed_and_published_is_what_the_master_says():
    said = Subscriptions({"/a": ["/record"], "/b": ["/other"]}, ["/b"])
    assert said.missing("/record", ("/a", "/b", "/c")) == ("/b", "/c")
    assert (said.silent(("/a", "/c")), said.silent(("/a", "/b"))) == (True, False)
    assert (Subscriptions().missing("/record", ("/a",)), Subscriptions().silent(("/a",))) == (None, False)


TOO_LONG = json.dumps({"main": {}, "second": "a" * 300_000})


@pytest.mark.parametrize("said", ["", "{", "3", '{"other": {}}', '{"main": 3}', '{"main": {"a": {}}}', TOO_LONG])
def test_what_the_collector_wants_and_cannot_be_compared_is_said_and_changes_nothing(said, caplog):
    machine = PlatformRecorder(PlatformSetup("main", ()))
    platform = SimpleNamespace(name="main", machine=machine, _share=SimpleNamespace(lock=threading.Lock()))
    RecorderPlatform._compare(platform, SimpleNamespace(data=said))
    assert "says nothing of main that could be compared" in caplog.text


def modes(folder, pattern):
    return {oct(path.stat().st_mode & 0o777) for path in folder.glob(pattern)}


def left(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_bag_in_a_part_that_is_no_recorders_is_named_in_the_log(tmp_path, caplog):
    ends = {"problem": "", "files": 1, "foreign": ["landing.bag"]}
    jobs = SimpleNamespace(run=lambda _request, _progress, ended: ended(ends))
    machine = SimpleNamespace(session_id="s1", facts=dict, recovery_ended=lambda *_, **__: None)
    share = SimpleNamespace(lock=threading.Lock(), jobs=jobs, now_ns=int, wake=threading.Event())
    disk = SimpleNamespace(cost="")
    platform = SimpleNamespace(name="main", machine=machine, folder=tmp_path, disk=disk, _share=share)
    RecorderPlatform._recover(platform, None)
    assert f"{tmp_path}/landing.bag is not a recorder's: it is not merged" in caplog.text


@pytest.mark.usefixtures("umask_of_nodes")
def test_what_is_kept_is_read_again_and_what_cannot_be_read_is_put_aside(tmp_path):
    memory = RecorderMemory(tmp_path / "state.json")
    assert memory.read() == (None, False)
    memory.keep({"platform": {"a": 1}})
    content, same_boot = RecorderMemory(memory.path).read()
    assert (content["platform"], same_boot) == ({"a": 1}, True)
    assert modes(tmp_path, "state.json") == {"0o640"}
    memory.put_aside()
    assert left(tmp_path) == ["state.json.bad"]
    assert modes(tmp_path, "state.json.bad") == {"0o640"}


def test_the_request_to_collect_names_what_is_fetched_and_what_lies_here(tmp_path):
    configuration = load_configuration(config_folder(), {"recording.apply_clock_offset": True})
    transfers = {each.name: each.transfer for each in configuration.recording.platforms}
    views = {
        name: SimpleNamespace(began=True, fetched=True, offsets={}, part=PlatformStatus(name, location=f"/rec/{name}"))
        for name in ("main", "second", "came", "emptied", "far")
    }
    views["far"].fetched = False
    (tmp_path / "s1_m" / "came").mkdir(parents=True)
    (tmp_path / "s1_m" / "came" / "parts.json").write_text("{}")
    known = {"main": views.pop("main"), "second": views.pop("second"), "third": SimpleNamespace(began=False)}
    collector = SimpleNamespace(
        views=known,
        taken_out=views,
        of_session={**known, **views},
        setup=SimpleNamespace(own="main"),
        session_id="s1",
        mission_id="m",
        stopped_ns=5,
        flights=[[1, 4]],
        set_back_ns=7,
        begun=2,
        wanted=collector_setup(configuration).wanted,
    )
    request = Collection(configuration, transfers).request(tmp_path / "s1_m", collector)
    assert request["output"] == str(tmp_path / "s1_m" / "s1_m.bag")
    assert [(each["platform"], each["folder"], each["fetched"]) for each in request["sources"]] == [
        ("main", "/rec/main", False),
        ("second", str(tmp_path / "s1_m" / "second"), True),
        ("came", str(tmp_path / "s1_m" / "came"), True),
    ]
    wanted = [each["wanted"] for each in request["sources"][:2]]
    images = {"topics": ["/realsense/image_raw", "/realsense/imu"], "match": [], "exclude": ""}
    assert (list(wanted[0]), wanted[1]) == (["states", "sensors", "cameras"], {"realsense": images})
    assert wanted[0]["states"]["topics"][:3] == ["/autonomy/journal", "/autonomy/state", "/watchdog/action"]
    listed = [platform_setup(configuration, name).groups for name in ("main", "second")]
    assert wanted == [{group.name: group.configured for group in groups} for groups in listed]
    assert {each["begun"] for each in request["sources"]} == {2}
    times = {name: request["facts"][name] for name in ("stopped_ns", "flights", "set_back_ns")}
    assert times == {"stopped_ns": 5, "flights": [[1, 4]], "set_back_ns": 7}
    assert (request["facts"]["tolerated_topics"], request["facts"]["absent"]) == ((), ["third"])
    assert request["facts"]["taken_out"] == {"emptied": "/rec/emptied", "far": "/rec/far"}


@pytest.mark.parametrize("by", ["rsync", "shared", "here"])
def test_what_a_stranger_says_of_a_parts_place_is_neither_fetched_nor_merged(tmp_path, monkeypatch, by):
    jobs = processes.RecorderJobs()
    monkeypatch.setattr(jobs, "_start", lambda *_, **__: pytest.fail("a program is started"))
    session, elsewhere = tmp_path / "s1_m", tmp_path / "else" / "where"
    elsewhere.mkdir(parents=True)
    (elsewhere / "parts.json").write_text("{}")
    words = f"it is said to lie in '{elsewhere}', which is no absolute path of a folder s1_m/second"
    transfer = Transfer(by, "second")
    assert jobs.fetch(transfer, str(elsewhere), session / "second", lambda _: None) == words
    assert not session.exists()
    view = SimpleNamespace(offsets={}, part=PlatformStatus("second", location=str(elsewhere)))
    collector = SimpleNamespace(of_session={"second": view}, setup=SimpleNamespace(own="main"), begun=1, wanted={})
    collection = Collection(load_configuration(config_folder()), {"second": transfer})
    assert collection.source(session, collector, "second")["folder"] == str(session / "second")
    view.part = PlatformStatus("second", location=f"{tmp_path}/disk/s1_m/second")
    here = by == "here"
    place = f"{tmp_path}/disk/s1_m/second" if here else str(session / "second")
    assert collection.source(session, collector, "second")["folder"] == place


SHARED = Transfer("shared")


@pytest.fixture
def sent(tmp_path):
    """Return the folder of a part of another platform, which is mounted here, and where it is to be fetched to."""
    there, here = tmp_path / "disk" / "s1_m" / "second", tmp_path / "here" / "s1_m" / "second"
    there.mkdir(parents=True)
    return there, here


@pytest.mark.parametrize(
    "content",
    [
        "{}",
        '{"files": null}',
        '{"files": {"a": 1}}',
        '{"files": ["a-01.bag"]}',
        '{"files": [{}]}',
        '{"files": [{"file": 1}]}',
        '{"files": [{"file": "\\udc80.bag"}]}',
        '{"files": [{"file": "a\\nb"}]}',
        '{"files": [], "gaps": 3}',
        '{"files": [], "logs": [1]}',
        '{"files": [], "logs": ["\\udc80"]}',
        "[]",
        "x",
    ],
)
def test_what_is_no_list_of_a_part_is_a_problem_in_words(sent, content):
    there, here = sent
    (there / "parts.json").write_text(content)
    words = f"{there}/parts.json is no list of a part; retry, and its platform lists anew what is there"
    assert processes.RecorderJobs().fetch(SHARED, str(there), here, lambda _: None) == words


def test_what_came_whole_before_is_not_fetched_again_and_what_went_bad_where_it_lies_replaces_no_good_copy(sent):
    there, here = sent
    good, listed = {"a-01.bag": b"first", "b-01.bag": b"second"}, []
    for name, content in good.items():
        (there / name).write_bytes(content)
        listed.append({"file": name, "bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()})
    (there / "parts.json").write_text(json.dumps({"files": listed}))
    assert processes.RecorderJobs().fetch(SHARED, str(there), here, lambda _: None) == ""
    (there / "a-01.bag").write_bytes(b"")  # its storage lost it
    (here / "b-01.bag").write_bytes(b"")  # ours did
    assert processes.RecorderJobs().fetch(SHARED, str(there), here, lambda _: None) == ""
    assert {name: (here / name).read_bytes() for name in good} == good


def in_a_thread(work):
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    return thread


def test_a_fetch_that_is_given_up_ends_and_starts_nothing_more(tmp_path, sent, monkeypatch):
    there, here = sent
    (there / "parts.json").write_text('{"files": []}')
    (tmp_path / "bin").mkdir()
    rsync = tmp_path / "bin" / "rsync"
    rsync.write_text(f"#!/bin/sh\necho $$ >> {tmp_path}/started\nexec sleep 600\n")
    rsync.chmod(0o755)
    monkeypatch.setenv("PATH", f"{rsync.parent}:{os.environ['PATH']}")
    jobs, problems = processes.RecorderJobs(), []
    thread = in_a_thread(lambda: problems.append(jobs.fetch(SHARED, str(there), here, print)))
    wait_for((tmp_path / "started").is_file, "its start")
    jobs.stop_fetch(here)
    thread.join(10.0)
    assert problems == ["rsync: status -9"]
    assert left(here) == [], "not even the names of what it wanted"


def test_a_fetch_that_hung_before_its_program_starts_none_when_it_was_given_up(sent, monkeypatch):
    """It looked at a mount that did not answer; now it does, and another fetch may be running."""
    there, here = sent
    goes_on, jobs, problems = threading.Event(), processes.RecorderJobs(), []
    monkeypatch.setattr(processes.subprocess, "Popen", lambda *_, **__: pytest.fail("a program is started"))
    monkeypatch.setattr(processes, "mounted", lambda *_: str(there) if goes_on.wait(10.0) else "")
    thread = in_a_thread(lambda: problems.append(jobs.fetch(SHARED, str(there), here, print)))
    wait_for(lambda: jobs._fetches, "its beginning")
    jobs.stop_fetch(here)
    goes_on.set()
    thread.join(10.0)
    assert problems == [f"{here}: it was given up"]


def test_a_fetch_that_raises_has_ended_and_says_why(tmp_path):
    configuration = load_configuration(config_folder())
    share = RecorderShare(configuration, tmp_path, lambda: 0, jobs=SimpleNamespace(fetch=lambda *_: {}["files"]))
    collector = RecorderCollector(share, SimpleNamespace(name="main"))
    view = collector.machine.views["second"]
    view.fetching = 7
    collector.commands[Transfers](Transfers("second", "/rec/s1_m/second", 7))
    wait_for(lambda: not view.fetching, "its end")
    assert (view.fetched, view.problem) == (False, "it could not be fetched (KeyError: 'files')")


def test_open_bags_and_the_names_of_files_are_put_on_the_disk_when_they_have_changed(tmp_path, monkeypatch):
    kept = []
    monkeypatch.setattr(processes, "_sync_file", lambda path: kept.append(path.name))
    monkeypatch.setattr(processes, "sync_folder", lambda path: kept.append(f"{path.name}/"))
    part = tmp_path / "recordings" / "s1_m" / "main"
    disk, bag = DiskSync(), part / "a-01.bag.active"
    disk.sync()
    disk.enter(part)
    disk.sync()
    assert kept == [], "nothing is there yet"
    part.mkdir(parents=True)
    (part / "a.log").write_text("a warning")
    bag.write_bytes(b"1")
    folders = ["main/", "s1_m/", "recordings/"]
    for happens, put in (
        (lambda: None, [bag.name, *folders]),
        (lambda: None, []),
        (lambda: bag.write_bytes(b"12"), [bag.name]),
        (lambda: bag.rename(part / "a-01.bag"), ["a-01.bag", *folders]),
    ):
        happens()
        disk.sync()
        assert kept == put
        kept.clear()
    assert disk.cost.startswith("put on the disk 3 times, ")


def test_a_disk_that_takes_nothing_is_said_and_tried_again(tmp_path, monkeypatch):
    disk = DiskSync()
    disk.enter(tmp_path)
    (tmp_path / "a-01.bag.active").write_bytes(b"1")

    def broken(_path):
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patched:
        patched.setattr(processes, "_sync_file", broken)
        disk.sync()
    assert disk.problem == f"{tmp_path}: cannot be put on the disk (Input/output error)"
    disk.sync()
    assert (disk.problem, disk.count) == ("", 1)


def complete(session, name, *entries, ok=True):
    """Leave a complete recording with its manifest: verified or not, of these files."""
    session.mkdir(exist_ok=True)
    (session / f"{name}.bag").write_bytes(b"all of it")
    output = {"file": f"{name}.bag", "bytes": 9, "sha256": hashlib.sha256(b"all of it").hexdigest()}
    inputs = [{"file": file, "sha256": sha256} for file, sha256 in entries]
    manifest = {"verified": {"ok": ok}, "output": output, "inputs": inputs}
    (session / f"{name}.manifest.json").write_text(json.dumps(manifest))


def test_what_may_be_removed_of_a_platform_is_what_the_verified_manifest_has_of_it(tmp_path):
    collection, session = Collection(load_configuration(config_folder()), {}), tmp_path / "s1_m"
    entries = [("main/a.bag", "1"), ("second/b.bag", "2"), ("../elsewhere/c.bag", "3")]
    for ok, expected in ((False, [{}, {}, {}]), (True, [{"a.bag": "1"}, {"b.bag": "2"}, {"c.bag": "3"}])):
        complete(session, "s1_m", *entries, ok=ok)
        folders = (session / "main", session / "second", tmp_path / "elsewhere")
        assert [collection.verified(session, {"folder": str(each)}) for each in folders] == expected
    complete(session, "s1_m-2", ("main/d.bag", "4"))
    assert collection.verified(session, {"folder": str(session / "main")}) == {"a.bag": "1", "d.bag": "4"}
    (session / "s1_m-2.manifest.json").unlink()
    (session / "s1_m.manifest.json").unlink()
    assert collection.verified(session, {"folder": str(session / "main")}) == {}


@pytest.mark.parametrize("now", [None, b"", b"all of i", b"all of IT"], ids=["gone", "empty", "cut", "changed"])
def test_nothing_may_be_removed_whose_verified_recording_is_not_there_as_it_was_verified(tmp_path, caplog, now):
    """Its manifest stays where somebody moves it to another disk, and where a disk loses it."""
    collection, session = Collection(load_configuration(config_folder()), {}), tmp_path / "s1_m"
    complete(session, "s1_m", ("main/a.bag", "1"), ("main/b.bag", "2"))
    complete(session, "s1_m-2", ("main/b.bag", "2"))
    output = session / "s1_m.bag"
    output.unlink() if now is None else output.write_bytes(now)
    assert collection.verified(session, {"folder": str(session / "main")}) == {"b.bag": "2"}
    assert f"{output} is not there as it was verified: the parts that it was made of stay" in caplog.text


def test_the_complete_recording_is_read_before_a_removal_by_nobody_who_would_keep_others_waiting(tmp_path):
    jobs, asked = [], []
    configuration = load_configuration(config_folder())
    share = RecorderShare(configuration, tmp_path, lambda: 0, workers=SimpleNamespace(submit=jobs.append))
    own = SimpleNamespace(name="main", remove=lambda *what: asked.append(what) or Answer(accepted=True))
    collector = RecorderCollector(share, own)
    machine = collector.machine
    machine.session_id, machine.mission_id = "s1", "m"
    machine.views["main"].part = PlatformStatus("main", location=str(tmp_path / "s1_m" / "main"))
    complete(tmp_path / "s1_m", "s1_m", ("main/a.bag", "1"))
    machine.views["main"].asking = True
    collector.commands[Ask](Ask("main", "remove"))
    assert (asked, machine.views["main"].asking) == ([], True)
    (job,) = jobs
    job()
    assert (asked, machine.views["main"].asking) == ([("s1", {"a.bag": "1"})], False)


@pytest.fixture
def ros_home(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path / "ros_home"))
    return tmp_path / "ros_home"


@pytest.mark.usefixtures("ros_home")
def test_the_journal_of_a_session_is_found_by_its_label_and_copied(tmp_path):
    run, session = tmp_path / "run", tmp_path / "s1_m"
    run.mkdir()
    session.mkdir()
    journal = create(run, '{"kind":"header","version":1,"label":"20261121T041730"}', Place().elsewhere)
    register("20261121T041730", journal.path)
    collection = Collection(load_configuration(config_folder()), {})
    collection.copy_journal(session, "20261121T041730-002", again=True)
    assert (session / "journal.jsonl").read_bytes() == journal.path.read_bytes()
    assert registered("20261121T041731-001") is None
    assert registered("a\0b-1") is None, "a name that can be none"
    journal.close()


@pytest.mark.usefixtures("ros_home")
def test_the_copy_in_a_session_is_not_replaced_by_the_journal_of_the_next_run(tmp_path):
    session, place = tmp_path / "s1_m", Place(output=str(tmp_path / "out"))
    session.mkdir()
    collection = Collection(load_configuration(config_folder()), {})
    copies = []
    for label, events in (("20261121T041730", 100), ("20261121T050000", 3)):
        header = f'{{"kind":"header","version":1,"label":"{label}"}}'
        journal = create(make_folder(place, label), header, place.elsewhere)
        for number in range(events):
            journal.append(encode_event(EngineStarted(t_ns=number, label=label)))
        journal.close()
        register(label, journal.path)
        collection.copy_journal(session, "20261121T041730-002", again=True)
        copies.append((session / "journal.jsonl").read_text())
    assert copies[0].count("\n") == 101
    assert copies[1] == copies[0]


@pytest.mark.usefixtures("ros_home", "umask_of_nodes")
@pytest.mark.parametrize("mode", [0o666, 0o644], ids=oct)
def test_what_is_copied_into_a_session_is_for_user_and_group_whoever_may_read_the_original(tmp_path, mode):
    run, session = tmp_path / "run", tmp_path / "s1_m"
    run.mkdir()
    session.mkdir()
    shutil.copytree(config_folder(), tmp_path / "config")
    journal = create(run, '{"kind":"header","version":1,"label":"20261121T041730"}', Place().elsewhere)
    journal.close()
    register("20261121T041730", journal.path)
    for path in (journal.path, *(each for each in (tmp_path / "config").rglob("*") if each.is_file())):
        path.chmod(mode)
    (session / "journal.jsonl").write_text("of an earlier copy")
    (session / "journal.jsonl").chmod(mode)
    (session / ".journal.jsonl.part").write_text("of one that was killed")
    (session / ".journal.jsonl.part").chmod(mode)
    collection = Collection(load_configuration(tmp_path / "config"), {})
    collection.copy_journal(session, "20261121T041730-002")
    folders = [session, *(path for path in session.rglob("*") if path.is_dir())]
    files = [path for path in session.rglob("*") if path.is_file()]
    assert {oct(path.stat().st_mode & 0o777) for path in folders} == {"0o750"}
    assert {oct(path.stat().st_mode & 0o777) for path in files} == {"0o640"}
    copies = {str(path.relative_to(session)) for path in files}
    assert copies > {"journal.jsonl", "configuration/effective.json", "configuration/sensors.yaml"}
    assert any(name.startswith("configuration/trajectories/") for name in copies)


def test_no_other_file_is_copied_into_a_session_whoever_names_it(tmp_path, ros_home):
    secret, fifo = tmp_path / "shadow", tmp_path / "journal.jsonl"
    secret.write_text("root:$6$secret")
    os.mkfifo(fifo)
    for path in (secret, fifo, tmp_path, tmp_path / "nothing"):
        register("a", path)
        assert registered("a-001") is None, path
    disguised = tmp_path / "other"
    disguised.mkdir()
    (disguised / "journal.jsonl").write_text("root:$6$secret\n")
    register("a", disguised / "journal.jsonl")
    assert registered("a-001") is None, "it is no journal"
    for session in ("", "a", "../a-001", "journals/a-001", ".-001"):
        assert registered(session) is None
    assert [path.name for path in (ros_home / "amaze_autonomy" / "journals").iterdir()] == ["a"]


def recorded(folder):
    """Make the folder of a session whose recording is complete, of a flight that ended before it began."""
    folder.mkdir()
    configuration = load_configuration(config_folder())
    header = encode_header(make_header(configuration.rules, configuration.effective, configuration.hash))
    events = [encode_event(EngineStarted(t_ns=1)), encode_event(Shutdown(t_ns=10**9))]
    (folder / "journal.jsonl").write_text("".join(f"{line}\n" for line in (header, *events)))
    write_bag(folder / f"{folder.name}.bag", flight_rows(2.0))
    return folder


@pytest.fixture
def session(tmp_path):
    return recorded(tmp_path / "20261121T041730-001_1")


def made(pages, session, said, most=1):
    pages.add(session)
    deadline = time.monotonic() + 120.0
    while len(said) < most and time.monotonic() < deadline:
        time.sleep(0.05)
    return said


@pytest.mark.live
@pytest.mark.usefixtures("umask_of_nodes")
def test_a_finished_recording_gets_its_page_once_by_a_process_of_its_own(session):
    said = []
    pages = FlightPages(lambda words, there: said.append((words, there)))
    assert made(pages, session, said) == [(str(session / "flight.html"), True)]
    assert modes(session, "flight.html") == {"0o640"}
    (session / "flight.html").unlink()
    pages.add(session)
    pages.stop()
    assert not (session / "flight.html").exists()


@pytest.mark.live
def test_a_page_that_the_next_recording_stops_is_made_after_that_with_its_own(session, tmp_path):
    said = []
    pages = FlightPages(lambda words, there: said.append((words, there)))
    second = recorded(tmp_path / "20261121T041730-002_2")
    third = recorded(tmp_path / "20261121T041730-003_3")
    pages.add(session)
    pages.stop()  # as for a mission out of the queue: milliseconds later
    pages.add(second)  # its end is heard when the next recording has begun
    time.sleep(0.5)
    waiting = f"no {session / 'flight.html'} yet: it is made after the recording that has begun"
    assert (said, list(tmp_path.rglob("flight.html"))) == ([(waiting, True)], [])
    pages.go_on()
    made(pages, third, said, 4)
    assert said[1:] == [(str(each / "flight.html"), True) for each in (session, second, third)]
    assert len(list(tmp_path.rglob("flight.html"))) == 3


@pytest.mark.live
def test_a_page_that_cannot_be_made_is_a_word_and_touches_nothing(session):
    (session / "journal.jsonl").write_text("no journal\n")
    before = {path.name: path.read_bytes() for path in session.iterdir()}
    said = []
    made(FlightPages(lambda words, there: said.append((words, there))), session, said)
    ((words, there),) = said
    assert not there
    journal = session / "journal.jsonl"
    assert words.startswith(f"no {session / 'flight.html'}: amaze-replay: {journal}: line 1: ")
    assert {path.name: path.read_bytes() for path in session.iterdir()} == before


def test_a_session_without_a_complete_recording_gets_no_page(tmp_path):
    pages = FlightPages(lambda words, there: pytest.fail(f"{words} {there}"))
    pages.add(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_of_a_recorder_that_ends_while_it_is_looked_at_it_is_known_how():
    children = processes.RecorderChildren({"one": None}, {}, {}, None, [])
    answers = iter([None, -9])
    own = SimpleNamespace(returncode=None)

    def poll():
        own.returncode = next(answers)
        return own.returncode

    own.poll = poll
    children._own["one"], children._processes["one"] = own, SimpleNamespace(alive=False)
    assert [children.running, children.running] == [("one",), ()]
    assert children._endings == {"one": "killed by SIGKILL"}


@pytest.fixture
def children(tmp_path):
    """Recorders of one group in a folder; the program of each writes down that it was started."""
    program = tmp_path / "record"
    program.write_text(f"#!/bin/sh\ntouch {tmp_path}/started\n")
    program.chmod(0o755)
    groups, topics, nodes = {"one": TopicGroup("one", ("/a",))}, {"one": ("/a",)}, {"one": "/record_one"}
    found = processes.RecorderChildren(groups, topics, nodes, Storage(), [str(program)])
    (tmp_path / "part").mkdir()
    found.enter(tmp_path / "part")
    return found


@pytest.mark.usefixtures("umask_of_nodes")
def test_the_part_of_a_session_with_what_its_recorders_say_is_for_user_and_group(tmp_path, children):
    """Recorders have the umask of who starts them."""
    (tmp_path / "record").write_text(f"#!/bin/sh\ntouch {tmp_path}/s1_m/main/one-01.bag\n")
    children.enter(tmp_path / "s1_m" / "main")
    assert children.start("one", 1) == ""
    children.wait(("one",), 10.0)
    assert modes(tmp_path, "s1_m") == modes(tmp_path, "s1_m/main") == {"0o750"}
    assert left(tmp_path / "s1_m" / "main") == ["one-01.bag", "one.log"]
    assert modes(tmp_path, "s1_m/main/*") == {"0o640"}


@pytest.mark.parametrize("there", ["one-02.bag", "one-02.bag.active", "one-02_0.bag", "one-02.bag.undo"])
def test_a_recorder_is_never_started_into_a_file_that_is_there(tmp_path, children, there):
    (tmp_path / "part" / there).write_bytes(b"the first part of a flight")
    assert children.look(Subscriptions()).groups["one"].number == 2
    for number in (1, 2):
        words = f"{tmp_path}/part/one-{number:02d}.bag: files up to number 2 are there, and are not written over"
        assert children.start("one", number) == words
    assert children.running == ()
    assert not (tmp_path / "started").exists()
    assert children.start("one", 3) == ""
    children.wait(("one",), 10.0)
    assert (tmp_path / "started").exists()
    assert (tmp_path / "part" / there).read_bytes() == b"the first part of a flight"


@pytest.mark.parametrize(
    "others, becomes, gone",
    [
        ((), None, True),
        (("one-01_0.bag",), None, True),
        (("one-01_0.bag",), "one-01_1.bag", False),
        ((), "one-01_1.bag", False),
    ],
)
def test_a_file_that_is_written_and_goes_is_missed_unless_it_was_closed(tmp_path, children, others, becomes, gone):
    part, program = tmp_path / "part", tmp_path / "record"
    program.write_text("#!/bin/sh\nexec sleep 60\n")
    assert children.start("one", 1) == ""
    try:
        for name in (*others, "one-01_1.bag.active"):
            (part / name).write_bytes(b"x")
        assert not children.look(Subscriptions()).groups["one"].removed
        if becomes:
            (part / "one-01_1.bag.active").rename(part / becomes)
        else:
            (part / "one-01_1.bag.active").unlink()
        looks = [children.look(Subscriptions()).groups["one"].removed for _ in range(3)]
        assert looks == [False, gone, gone], "a look while it is renamed is none"
    finally:
        children.signal("one", "KILL")
        children.wait(("one",), 10.0)


def test_a_process_that_somebody_stopped_is_seen_and_can_be_told_to_go_on(tmp_path, children):
    (tmp_path / "record").write_text("#!/bin/sh\nexec sleep 60\n")
    assert children.start("one", 1) == ""
    try:
        for word, expected in (("STOP", True), ("CONT", False)):
            children.signal("one", word)
            wait_for(lambda expected=expected: children.look(Subscriptions()).groups["one"].halted == expected, word)
            assert children.look(Subscriptions()).groups["one"].running
    finally:
        children.signal("one", "KILL")
        children.wait(("one",), 10.0)


def test_a_recorder_of_a_group_that_is_not_configured_any_more_is_found_and_can_be_told_to_end(tmp_path, children):
    (tmp_path / "record").write_text("#!/bin/sh\nexec sleep 60\n")
    assert children.start("one", 1) == ""
    later = processes.RecorderChildren({}, {}, {}, Storage(), [])
    try:
        later.remember(children.memory())
        later.enter(tmp_path / "part")
        assert (later.running, later.look(Subscriptions({})).groups["one"].running) == (("one",), True)
        assert later.memory() == children.memory(), "so does the next process of the node"
        later.signal("one", "TERM")  # a shell in the background ignores INT, as does what it starts
        children.wait(("one",), 10.0)
        seen = later.look(Subscriptions({})).groups["one"]
        assert (seen.running, seen.ending) == (False, "it is not in the configuration any more")
    finally:
        children.signal("one", "KILL")
        children.wait(("one",), 10.0)


def test_what_was_seen_of_one_session_is_no_ground_for_what_is_done_in_another(tmp_path):
    """A session begins while the files of the one before are looked at."""
    machine = SimpleNamespace(session_id="s1", step=lambda *_: pytest.fail("it decides by files of another session"))

    def look(*_):
        machine.session_id = "s2"
        return ProcessStatus()

    platform = SimpleNamespace(
        machine=machine,
        _share=SimpleNamespace(lock=threading.Lock(), stamp_ns=lambda: 0, folder=tmp_path),
        _enter=lambda: None,
        _children=SimpleNamespace(look=look),
        _master=SimpleNamespace(seen=lambda: ({}, [])),
        _cpu=SimpleNamespace(look=lambda: None),
    )
    assert RecorderPlatform.step(platform) == []


@pytest.fixture
def parameters(monkeypatch):
    """Return the parameters that the node finds."""
    given = {}
    monkeypatch.setattr(recorder_node.rospy, "get_param", given.get)
    monkeypatch.setattr(recorder_node.rospy, "loginfo", lambda text, *values: given["said"].append(text % values))
    given["said"] = []
    return given


def test_a_recorder_that_the_simulation_starts_for_a_platform_that_there_is_not_waits(parameters):
    parameters.update({"~platform": "third", "~optional": True})
    node = make_recorder(load_configuration(config_folder()), SimpleNamespace(ros_ns=lambda: 0))
    assert isinstance(node, AbsentPlatform)
    assert parameters["said"] == ["recording.yaml has no platform third: nothing is recorded here"]
    thread = threading.Thread(target=node.run, daemon=True)
    thread.start()
    assert thread.is_alive()
    node.end()
    thread.join(10.0)
    assert not thread.is_alive()


def test_a_platform_that_there_is_not_is_a_mistake_of_who_starts_its_recorder(parameters):
    parameters["~platform"] = "third"
    with pytest.raises(StartError) as caught:
        make_recorder(load_configuration(config_folder()), SimpleNamespace(ros_ns=lambda: 0))
    assert str(caught.value) == "~platform is 'third', recording.yaml has main, second"


def test_recordings_in_a_home_that_nobody_has_are_refused_and_no_folder_of_that_name_is_made(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["data_recorder", "--folder", "~nobody_of_this_name/rec"])
    with pytest.raises(StartError) as caught:
        recordings_folder(load_configuration(config_folder()))
    said = "~nobody_of_this_name/rec: there is no such home; name another one with --folder"
    assert (str(caught.value), list(tmp_path.iterdir())) == (said, [])


def test_a_folder_of_recordings_that_is_no_whole_path_is_refused_as_the_node_has_the_current_folder_of_its_starter(
    monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["data_recorder", "--folder", "rec"])
    with pytest.raises(StartError) as caught:
        recordings_folder(load_configuration(config_folder()))
    assert (str(caught.value), list(tmp_path.iterdir())) == ("rec: is no whole path; name one with --folder", [])


# --- one recorder of a platform in a folder ---------------------------------------------------------------------------


HOLDS = (
    "import sys, time; from pathlib import Path; from amaze_autonomy.nodes.recorder.node import RecorderLock; "
    "print(RecorderLock(Path(sys.argv[1]), lambda: False).take(), flush=True); time.sleep(60)"
)


@pytest.fixture
def holder(tmp_path):
    """Return a process that holds the lock of a folder."""
    command = [sys.executable, "-c", HOLDS, str(tmp_path / ".recorder-main.lock")]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"True\n"
        yield process
        process.kill()


def lock(tmp_path, platform="main", over=lambda: False):
    return RecorderLock(tmp_path / f".recorder-{platform}.lock", over)


def test_a_second_recorder_of_a_platform_in_a_folder_is_refused_and_told_who_has_it(tmp_path, holder, monkeypatch):
    monkeypatch.setattr(recorder_node, "_LET_GO_LIMIT_S", 0.2)
    with pytest.raises(StartError) as caught:
        lock(tmp_path).take()
    assert str(caught.value) == (
        f"{tmp_path}: process {holder.pid} on {socket.gethostname()} records the same platform there; "
        "end it first, or name another folder with --folder"
    )
    assert lock(tmp_path, "second").take(), "another platform on the same storage"
    assert not lock(tmp_path, over=lambda: True).take(), "who is told to end waits no longer"


@pytest.mark.usefixtures("parameters", "holder")
def test_a_node_that_is_refused_touches_nothing_of_the_other_one(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_node, "RecorderShare", lambda *_: SimpleNamespace(folder=tmp_path))
    for name in ("recordings_folder", "RecorderPlatform", "RecorderCollector", "RecorderTeller"):
        monkeypatch.setattr(recorder_node, name, lambda *_, **__: SimpleNamespace(commands={}))
    monkeypatch.setattr(recorder_node, "_LET_GO_LIMIT_S", 0.2)
    node = DataRecorderNode(load_configuration(config_folder()), SimpleNamespace(ros_ns=lambda: 0))
    with pytest.raises(StartError, match="records the same platform there"):
        node.run()
    node._ended = True
    node.run()  # returns: it would fail with these parts
    assert left(tmp_path) == [".recorder-main.lock"]


def test_the_lock_of_a_recorder_that_ends_or_is_killed_goes_with_it(tmp_path, holder):
    threading.Timer(0.5, holder.kill).start()
    assert lock(tmp_path).take()
    assert modes(tmp_path, ".recorder-main.lock") == {"0o640"}


def test_the_lock_is_not_held_by_recorders_which_go_on_without_their_node(tmp_path, children):
    (tmp_path / "record").write_text("#!/bin/sh\nexec sleep 30\n")
    assert lock(tmp_path).take()
    assert children.start("one", 1) == ""
    pid = children._own["one"].pid
    wait_for(lambda: Path(f"/proc/{pid}/comm").read_text() == "sleep\n", "its program")
    held = {"/dev/null", f"{tmp_path}/part/one.log"}
    wait_for(lambda: open_files(pid) == held, f"nothing but {held}")  # while it is loaded it opens libraries
    children.signal("one", "KILL")


def open_files(pid):
    """Return what a process has open; one that is closed just now is not."""
    found = set()
    for each in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):
            found.add(os.readlink(each))
    return found


def test_a_storage_that_takes_no_lock_keeps_nobody_from_recording(tmp_path, caplog):
    assert lock(tmp_path / "nothing").take()
    (said,) = [each for each in caplog.messages if ".recorder-main.lock" in each]
    assert said.endswith("No such file or directory; no second recorder is kept from this folder")


@pytest.mark.usefixtures("parameters")
def test_the_status_goes_out_at_the_rate_of_the_configuration(monkeypatch):
    monkeypatch.setattr(recorder_node, "RecorderShare", lambda *_: SimpleNamespace(folder=Path("/rec")))
    for name in ("recordings_folder", "RecorderPlatform", "RecorderCollector", "RecorderTeller"):
        monkeypatch.setattr(recorder_node, name, lambda *_, **__: SimpleNamespace(commands={}))
    configuration = load_configuration(config_folder(), ["autonomy.streams.recorder_status_rate_hz=4"])
    node = DataRecorderNode(configuration, SimpleNamespace(ros_ns=lambda: 0))
    waits = []

    def sleep(seconds):
        waits.append(seconds)
        node._ended = len(waits) == 2

    monkeypatch.setattr(recorder_node.time, "sleep", sleep)
    monkeypatch.setattr(node, "_tell", lambda **_: None)
    node._tell_always()
    assert waits == [0.25, 0.25]
