#!/usr/bin/env python3
"""Real recorder nodes with rosbag's recorder on two platforms: killed, cut off, full, with another clock.

Two topics carry numbers, one for each platform, so that every message that is missing in the end is known.
"""

from __future__ import annotations

import fcntl
import json
import os
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from contextlib import suppress
from pathlib import Path
from typing import Any, Dict, List, Optional, Set

import roslib.packages
import rospy
import rostest
from hitches import allowed_s
from modes import DEFAULT, PERMISSIVE, assert_modes, started_under
from one_node import wait_for, wait_for_end, wait_for_service
from stack import Stack, TestConfiguration
from std_msgs.msg import String

sys.path.append(str(Path(__file__).resolve().parents[1]))
from drawn import is_drawn

from amaze_autonomy import msg, srv
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.recording import Recording
from amaze_autonomy.engine.events import RecordingPhase
from amaze_autonomy.paths import config_folder
from amaze_autonomy.recording.parts import close_parts
from amaze_autonomy.recording.storage import read_json
from amaze_autonomy.ros.rospy_flaws import mend_rospy

PHASE = RecordingPhase
PLATFORMS = ("main", "second")
UMASKS = {"main": PERMISSIVE, "second": DEFAULT}  # of who starts the node of each
OTHER_PEERS = "watchdog,landing_detection,state_estimation,autopilot,mission_planner"  # than the recorder
RATE_HZ = 200
ANOTHER_TIME = "the night has it, and each commit draws another quarter (test/drawn.py)"
CUTS = int(os.environ.get("AMAZE_CUTS", "3"))
LOST_BY_A_CUT_S = 1.5
LZ4_CHUNK_BYTES = 64 * 1024  # what a chunk holds before it is compressed (docs/configuration.md, chunk_kb)
MESSAGES_LOST_BY_A_CUT = 3  # at one a second: the last one, and what came in the time of a sync
TOLD_WITHIN_S = 0.5  # of what is missing: record times against numbers, on a busy machine
EXT4_SHUTDOWN, WITHOUT_LOG = 0x8004587D, 2  # linux/fs/ext4: what xfstests cuts the power with; nothing more is written
CONFIGURATION = """
folder: {folder}
collector: main
storage: {{min_free_gb: 0.0, min_free_fraction: 0.0, reserve_mb: {reserve}, compression: {compression}}}
start_limit_s: 12.0
stop_limit_s: 4.0
platform_limit_s: 2.0
apply_clock_offset: true
keep_parts: {keep}
platforms:
  main: {{groups: [one]}}
  second: {{groups: [two]{transfer}}}
groups:
  one: {{topics: [main/numbers], expected_mb_s: 0.0}}
  two: {{topics: [second/numbers], expected_mb_s: 0.0}}
"""
# Whoever loads this has a clock that is 3 s ahead; the monotonic one is left alone.
ANOTHER_CLOCK = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <sys/time.h>
#include <time.h>
int clock_gettime(clockid_t which, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int status = real(which, now);
    if (!status && which == CLOCK_REALTIME) now->tv_sec += 3;
    return status;
}
int gettimeofday(struct timeval *now, void *zone) {
    struct timespec t;
    (void)zone;
    int status = clock_gettime(CLOCK_REALTIME, &t);
    now->tv_sec = t.tv_sec;
    now->tv_usec = t.tv_nsec / 1000;
    return status;
}
"""


class Numbers:
    """Publishes numbers on one topic, so fast and so large."""

    def __init__(self, topic: str, size: int = 100, rate_hz: int = RATE_HZ) -> None:
        self._publisher = rospy.Publisher(topic, String, queue_size=1000)
        self._size, self._period_s, self.sent = size, 1.0 / rate_hz, 0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        due_s = time.monotonic()
        while not self._stopped.is_set():
            self._publisher.publish(String(f"{self.sent} " + "x" * self._size))
            self.sent += 1
            due_s += self._period_s
            self._stopped.wait(max(0.0, due_s - time.monotonic()))

    def stop(self) -> None:
        self._stopped.set()
        self._thread.join(10.0)
        self._publisher.unregister()


class Recorders:
    """The nodes of one test in a namespace and a folder of their own."""

    def __init__(
        self,
        name: str,
        reserve_mb: int = 0,
        storage: Optional[Path] = None,
        size: int = 100,
        keep: str = "true",
        transfer: str = "",
        rate_hz: int = RATE_HZ,
        compression: str = "none",
    ) -> None:
        self.name = name
        self.folder = Path(tempfile.mkdtemp(prefix=f"amaze_{name}_"))
        self.storage = storage or self.folder / "storage"
        self._config = self.folder / "config"
        shutil.copytree(config_folder(), self._config)
        given = {"reserve": reserve_mb, "keep": keep, "transfer": transfer, "compression": compression}
        text = CONFIGURATION.format(folder=self.storage, **given)
        text = text.replace("main/numbers", f"/{name}/main/numbers").replace(
            "second/numbers", f"/{name}/second/numbers"
        )
        (self._config / "recording.yaml").write_text(text)
        self.nodes: Dict[str, subprocess.Popen[bytes]] = {}
        self._changed = threading.Condition()
        self.statuses: List[Any] = []
        self._subscriber = rospy.Subscriber(f"/{name}/data_recorder/status", msg.RecordingStatus, self._see)
        self.numbers = {each: Numbers(f"/{name}/{each}/numbers", size, rate_hz) for each in PLATFORMS}

    def _see(self, message: Any) -> None:
        with self._changed:
            self.statuses.append(message)
            self._changed.notify_all()

    def configure(self, platform: str, old: str, new: str) -> None:
        """Give a platform a copy of the configuration in which recording.yaml has something else."""
        copy = shutil.copytree(self._config, self.folder / f"config_{platform}") / "recording.yaml"
        text = copy.read_text()
        assert old in text
        copy.write_text(text.replace(old, new))

    @property
    def written_in(self) -> List[Path]:
        """The folders that the nodes write in."""
        return [self.storage / each for each in PLATFORMS]

    def start_node(self, platform: str, **environment: str) -> None:
        rospy.set_param(f"/{self.name}/data_recorder_{platform}/platform", platform)
        command = [roslib.packages.find_node("amaze_autonomy", "data_recorder")[0], f"__name:=data_recorder_{platform}"]
        copy = self.folder / f"config_{platform}"
        config = copy if copy.is_dir() else self._config
        command += ["--config", str(config), "--folder", str(self.storage / platform)]
        variables = {**os.environ, "ROS_NAMESPACE": f"/{self.name}", **environment}
        with (self.folder / f"{platform}.log").open("ab") as log:
            command = started_under(UMASKS[platform], command)
            self.nodes[platform] = self._spawn(platform, command, env=variables, stdout=log, stderr=log)

    def _spawn(self, _platform: str, command: List[str], **more: Any) -> subprocess.Popen[bytes]:
        return subprocess.Popen(command, **more)

    def ask(self, verb: str, session: str = "s1", platform: str = "") -> Any:
        """Ask the collector, or the recorder of a platform."""
        service = {"start": srv.StartRecording, "stop": srv.StopRecording}[verb]
        name = f"/{self.name}/{platform and platform + '/'}data_recorder/{verb}"
        wait_for_service(name)
        words = [session, "none"] if verb == "start" else [session]
        began_s = time.monotonic()
        answer = rospy.ServiceProxy(name, service)(*words)
        assert time.monotonic() - began_s < allowed_s(1.0, began_s), "a request is answered at once"
        return answer

    @property
    def status(self) -> Any:
        return self.statuses[-1] if self.statuses else None

    def told_of_computers(self) -> bool:
        """Return whether load and free storage of all computers are known, and the clock of the other one."""
        told = [] if self.status is None else self.status.platforms
        return (
            len(told) == len(PLATFORMS)
            and all(0.0 <= each.cpu_fraction <= 1.0 and 0.0 < each.free_fraction <= 1.0 for each in told)
            and [abs(each.clock_age) < 1.0 for each in told] == [False, True]
        )

    def wait_phase(self, phase: Any, limit_s: float = 60.0) -> Any:
        def reached() -> Any:
            status = self.status
            return status if status is not None and status.phase == phase.value else None

        try:
            return wait_for(reached, phase.name, limit_s)
        except AssertionError as error:
            raise AssertionError(f"{error}; last: {self.status}\n{self.log()}") from error

    def log(self) -> str:
        return "".join(path.read_text(errors="replace")[-2000:] for path in sorted(self.folder.glob("*.log")))

    def state(self, platform: str) -> Dict[str, Any]:
        return read_json(self.storage / platform / f".recorder-{platform}.json") or {}

    def process(self, platform: str, group: str) -> int:
        """Return the process that records a group; it may be about to start."""
        found = wait_for(lambda: self.state(platform).get("processes", {}).get(group), f"the recorder of {group}")
        return int(found[0])

    def received(self, platform: str) -> Set[int]:
        """Return the numbers in the complete recording."""
        with Recording(Path(self.status.location)) as recording:
            entries = recording.entries(f"/{self.name}/{platform}/numbers")
            return {int(recording.message(entry).data.split()[0]) for entry in entries}

    def close(self) -> None:
        self._subscriber.unregister()
        for numbers in self.numbers.values():
            numbers.stop()
        for node in self.nodes.values():
            if node.poll() is None:
                node.send_signal(signal.SIGINT)
        for node in self.nodes.values():
            try:
                wait_for_end(node)
            except subprocess.TimeoutExpired:
                node.kill()
                node.wait()
        for path in self.storage.glob("*/.recorder-*.json"):
            for pid, _ in ((read_json(path) or {}).get("processes") or {}).values():
                assert not Path(f"/proc/{pid}").exists(), "a recorder was left behind"
        try:
            for folder in self.written_in:
                assert_modes(folder)
        finally:
            shutil.rmtree(self.folder, ignore_errors=True)


class Ext4:
    """A file system of its own on an image, whose power can be cut.

    Raises:
        unittest.SkipTest: it cannot be made here.
    """

    def __init__(self, folder: Path) -> None:
        if os.geteuid() != 0:
            raise unittest.SkipTest("NOT TESTED: power cuts: only root can mount an ext4 image")
        self._image, self.folder = folder / "image0", folder / "mounted"
        self.folder.mkdir()
        with self._image.open("wb") as image:
            image.truncate(96 << 20)
        make = shutil.which("mkfs.ext4", path=f"{os.environ['PATH']}:/usr/sbin:/sbin")
        if make is None:
            raise unittest.SkipTest("NOT TESTED: power cuts: there is no mkfs.ext4 (e2fsprogs)")
        self._run(make, "-q", "-F", str(self._image))
        self.mount()

    def _run(self, *command: str) -> None:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
        if done.returncode:
            raise unittest.SkipTest(f"NOT TESTED: power cuts: {' '.join(command[:1])}: {done.stderr.strip()}")

    def mount(self) -> None:
        self._run("mount", "-o", "loop", str(self._image), str(self.folder))

    def unmount(self) -> None:
        with suppress(subprocess.TimeoutExpired):
            subprocess.run(["umount", "--lazy", str(self.folder)], check=False, timeout=60)

    def cut(self) -> None:
        """Cut the power: what is not on the disk now never gets there."""
        file = os.open(self.folder, os.O_RDONLY)
        try:
            fcntl.ioctl(file, EXT4_SHUTDOWN, struct.pack("I", WITHOUT_LOG))
        finally:
            os.close(file)

    def restart(self) -> None:
        """Have the power back: a copy of what the disk has, as the kernel may still hold the one that was cut."""
        self.unmount()
        before, self._image = self._image, self._image.with_name(f"image{int(self._image.name[5:]) + 1}")
        shutil.copyfile(before, self._image)
        before.unlink()
        self.mount()


def another_clock(folder: Path) -> Path:
    """Return a library whose users have a clock that is 3 s ahead."""
    library = folder / "another_clock.so"
    command = ["cc", "-shared", "-fPIC", "-o", str(library), "-xc", "-", "-ldl"]
    subprocess.run(command, input=ANOTHER_CLOCK.encode(), check=True, timeout=120)
    return library


def holes(numbers: Set[int]) -> List[int]:
    """Return the lengths of what is missing between the first and the last number."""
    ordered = sorted(numbers)
    return [after - before - 1 for before, after in zip(ordered, ordered[1:]) if after - before > 1]


class TestRecorder(unittest.TestCase):
    """Each test has nodes of its own."""

    def recorders(self, name: str, **options: Any) -> Recorders:
        recorders = Recorders(name, **options)
        self.addCleanup(recorders.close)
        return recorders

    def test_killed_recorder_killed_node_and_killed_merge_lose_no_more_than_the_recorder_did_not_write(self) -> None:
        recorders = self.recorders("killed")
        for platform in PLATFORMS:
            recorders.start_node(platform)
        wait_for(recorders.told_of_computers, "load and storage of both computers, before any session")
        self.assertTrue(recorders.ask("start").accepted)
        recorders.wait_phase(PHASE.RECORDING)
        time.sleep(1.0)  # so much is recorded before

        killed, killed_s = recorders.process("second", "two"), time.monotonic()
        os.kill(killed, signal.SIGKILL)
        wait_for(lambda: recorders.process("second", "two") != killed, "another recorder")
        wait_for(lambda: "interrupted once" in recorders.status.platforms[1].message, "the word about it")
        wait_for(lambda: all(each.growing for each in recorders.status.platforms), "growth on both platforms")
        away_s = time.monotonic() - killed_s

        kept = recorders.process("main", "one")
        recorders.nodes["main"].kill()
        recorders.nodes["main"].wait()
        time.sleep(0.5)  # without a node for so long
        recorders.start_node("main")
        seen = len(recorders.statuses)
        wait_for(lambda: len(recorders.statuses) > seen, "the node's word")
        recorders.wait_phase(PHASE.RECORDING)
        wait_for(lambda: all(each.growing for each in recorders.status.platforms), "growth on both platforms")
        self.assertEqual(recorders.process("main", "one"), kept)
        self.assertTrue(Path(f"/proc/{kept}").exists())

        self.assertTrue(recorders.ask("stop").accepted)
        jobs: Set[int] = set()
        for _ in range(4):  # at least one of them recovers, and one merges
            (job, *_) = wait_for(lambda: _jobs_of(recorders.nodes["main"].pid) - jobs, "a process that works on bags")
            os.kill(job, signal.SIGKILL)
            jobs.add(job)
        status = recorders.wait_phase(PHASE.COMPLETE)

        self.assertEqual(holes(recorders.received("main")), [])
        lost = holes(recorders.received("second"))
        self.assertEqual(len(lost), 1, lost)
        self.assertLess(lost[0], RATE_HZ * away_s, "more than what nobody was there for")
        self.assertIn("verified; lost: second/two", status.message)
        self.assertIn("killed by SIGKILL", status.message)
        print(f"killed recorder: {lost[0]} messages at {RATE_HZ} Hz; killed node and merge: 0; {status.message}")

    def test_no_stranger_takes_a_session_over_or_has_a_part_written_over_in_flight(self) -> None:
        recorders = self.recorders("stranger")
        for platform in PLATFORMS:
            recorders.start_node(platform)
        wait_for(recorders.told_of_computers, "both platforms")
        engine = rospy.Publisher("/stranger/autonomy/state", msg.AutonomyState, queue_size=10, latch=True)
        wait_for(lambda: engine.get_num_connections() > 0, "the collector to hear the engine")
        self.assertTrue(recorders.ask("start").accepted)
        engine.publish(_state("s1", in_flight=False))
        recorders.wait_phase(PHASE.RECORDING)
        engine.publish(_state("s1", in_flight=True))
        time.sleep(1.0)  # so much is recorded before
        for platform in ("", *PLATFORMS):
            answer = recorders.ask("start", "evil", platform)
            self.assertEqual((answer.accepted, answer.message), (False, "records s1; stop that one first"))

        (part,) = (recorders.storage / "second").glob("*/second")
        self.assertTrue(recorders.ask("stop", "s1", "second").accepted)
        self.assertTrue(recorders.ask("start", "evil", "second").accepted)  # it may begin, when the other one is closed
        wait_for(lambda: (part / "two-01.bag").exists(), "the first part")
        first = (part / "two-01.bag").read_bytes()
        wait_for(lambda: [*part.glob("two-02.bag*")], "the next one")
        wait_for(lambda: all(each.growing for each in recorders.status.platforms), "growth on both platforms")
        time.sleep(1.0)  # so much is recorded afterwards
        engine.publish(_state("s1", in_flight=False))
        wait_for(lambda: recorders.state("main")["collector"]["flights"][0][1], "the landing")
        self.assertTrue(recorders.ask("stop").accepted)
        status = recorders.wait_phase(PHASE.COMPLETE)
        self.assertEqual((part / "two-01.bag").read_bytes(), first)
        self.assertEqual(holes(recorders.received("main")), [])
        lost = holes(recorders.received("second"))
        self.assertEqual(len(lost), 1, lost)
        self.assertRegex(
            status.lost, r"^second/two: \d+\.\d s, in which nothing was recorded \(it was stopped and started again\)$"
        )
        print(f"stopped by a stranger in flight: {lost[0]} messages at {RATE_HZ} Hz; {status.message}")

        self.assertTrue(recorders.ask("start", "s2").accepted)
        recorders.wait_phase(PHASE.RECORDING)
        engine.publish(_state("s3", in_flight=False))  # an engine that was started anew, without its journal
        wait_for(lambda: recorders.ask("start", "s3").accepted, "its own session, on the ground")
        wait_for(lambda: recorders.status.session_id == "s3", "a word of it")
        recorders.wait_phase(PHASE.RECORDING)
        self.assertTrue(recorders.ask("stop", "s3").accepted)
        self.assertIn("nothing was lost", recorders.wait_phase(PHASE.COMPLETE).message)

    def test_a_second_platform_that_never_answers_is_named_and_nothing_of_the_first_is_lost(self) -> None:
        recorders = self.recorders("alone")
        recorders.start_node("main")
        self.assertTrue(recorders.ask("start").accepted)
        status = recorders.wait_phase(PHASE.FAILED, 25.0)
        self.assertRegex(status.message, r"^second does not answer \(.*\): is its data_recorder running")
        self.assertTrue(recorders.ask("stop").accepted)
        wait_for(lambda: recorders.status.message.startswith("the part of second is missing"), "what is missing", 15.0)
        self.assertEqual(recorders.status.phase, PHASE.FAILED.value)
        (bag,) = (recorders.storage / "main").glob("*/main/one-01.bag")
        with Index(bag) as index:
            self.assertGreater(sum(chunk.messages for chunk in index.chunks), RATE_HZ)
        self.assertIn(str(bag.parent), recorders.status.message)

        recorders.start_node("second")
        wait_for_service("/alone/second/data_recorder/start")
        self.assertTrue(recorders.ask("start", "s2").accepted)
        recorders.wait_phase(PHASE.RECORDING)
        self.assertTrue(recorders.ask("stop", "s2").accepted)
        self.assertIn("nothing was lost", recorders.wait_phase(PHASE.COMPLETE).message)
        self.assertEqual([holes(recorders.received(each)) for each in PLATFORMS], [[], []])

    def small_storage(self, name: str, megabytes: int) -> Path:
        """Mount a storage that can become full; `make_room` makes it larger."""
        folder = Path(tempfile.mkdtemp(prefix=f"amaze_{name}_"))
        self.addCleanup(shutil.rmtree, folder, ignore_errors=True)
        if os.geteuid() != 0:
            self.skipTest("NOT TESTED: only root can mount a small storage")
        words = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)]
        done = subprocess.run(words, capture_output=True, check=False, timeout=60)
        if done.returncode:
            self.skipTest(f"NOT TESTED: a small storage cannot be mounted here: {done.stderr.decode().strip()}")
        self.addCleanup(subprocess.run, ["umount", "--lazy", str(folder)], check=True)
        return folder

    def test_what_a_copy_of_the_configuration_lacks_is_said_while_it_records_whoever_started_first(self) -> None:
        recorders = Recorders("copies")
        try:
            topic = "/copies/second/numbers"
            recorders.configure("main", f"[{topic}]", f"[{topic}, /copies/second/more]")
            recorders.start_node("second")
            recorders.start_node("main")
            wait_for_service("/copies/second/data_recorder/start")
            self.assertTrue(recorders.ask("start").accepted)
            recorders.wait_phase(PHASE.RECORDING)
            lacks = "/copies/second/more is not in its configuration"
            said = lambda: [each.message for each in recorders.status.platforms] == ["", lacks]  # noqa: E731
            wait_for(said, "what it lacks")
            recorders.nodes["second"].kill()
            recorders.nodes["second"].wait()
            recorders.start_node("second")  # as `respawn` does
            seen = len(recorders.statuses)
            wait_for(lambda: len(recorders.statuses) > seen + 2, "statuses of what is now")
            wait_for(said, "what it lacks, again")
            self.assertTrue(recorders.ask("stop").accepted)
            status = recorders.wait_phase(PHASE.COMPLETE)
            self.assertEqual(status.lost, f"second: {lacks}")
            self.assertIn("copy the collector's configuration to this computer", recorders.log())
        finally:
            recorders.close()

    def test_a_full_storage_is_said_before_and_during_and_what_was_written_is_whole(self) -> None:
        folder = self.small_storage("full", 50)
        recorders = self.recorders("full", reserve_mb=12, storage=folder, size=20_000)
        for platform in PLATFORMS:
            recorders.start_node(platform)
        self.assertTrue(recorders.ask("start").accepted)
        recorders.wait_phase(PHASE.RECORDING)
        said = lambda words: [words in each.message for each in recorders.status.platforms]  # noqa: E731
        wait_for(lambda: any(said("the storage is full in ")), "the word before")
        wait_for(lambda: all(said("recording has stopped")), "the word during, of both", 40.0)
        self.assertTrue(recorders.ask("stop").accepted)
        status = recorders.wait_phase(PHASE.FAILED)
        self.assertRegex(status.message, "there is no space for it.*make space and try again, nothing was changed")
        parts = sorted(folder.glob("*/*/*/*-01.bag"))
        self.assertGreaterEqual(len(parts), len(PLATFORMS))
        for part in parts:
            with Index(part) as index:
                self.assertGreater(sum(chunk.messages for chunk in index.chunks), 100)
        make_room(folder)
        self.assertTrue(recorders.ask("stop").accepted)
        status = recorders.wait_phase(PHASE.COMPLETE)
        self.assertEqual([*seconds_lost(status.lost, "the storage was full")], ["main/one", "second/two"])
        self.assertEqual([holes(recorders.received(each)) for each in PLATFORMS], [[], []], recorders.log()[-4000:])
        self.assertIn(f"verified; lost: {status.lost}", status.message)
        print(
            f"full at {sum(part.stat().st_size for part in parts) / 1e6:.0f} MB; after space was made: {status.message}"
        )

    def test_what_a_storage_that_is_full_in_flight_costs_is_a_loss_and_the_engine_ends_with_status_6(self) -> None:
        """There is room again in flight, and recorders, flight and engine go on as if nothing had happened."""
        folder, name = self.small_storage("full_in_flight", 30), "full_in_flight"
        shared = ", transfer: {by: shared}"  # what came from the other platform is a copy
        recorders = self.recorders(name, reserve_mb=12, storage=folder, size=5_000, transfer=shared)
        for platform in PLATFORMS:
            recorders.start_node(platform)
        wait_for(recorders.told_of_computers, "both platforms")
        configuration = TestConfiguration()
        self.addCleanup(configuration.remove)
        ended = {"exit_when_ended": True}
        stack = Stack(
            name, configuration.folder, mission="long", parameters=ended, processes=(OTHER_PEERS,), patience_s=90.0
        )
        self.addCleanup(stack.remove)
        self.addCleanup(stack.stop)
        stack.start()
        stack.wait_state("MISSION")
        said = lambda words: [words in each.message for each in recorders.status.platforms]  # noqa: E731
        began_s = time.monotonic()
        wait_for(lambda: all(said("recording has stopped")), "a full storage", 40.0)
        time.sleep(2.0)  # so long nothing is recorded
        make_room(folder)
        wait_for(lambda: all(each.growing for each in recorders.status.platforms), "growth on both platforms")
        self.assertEqual(stack.state, "MISSION")
        self.assertEqual(stack.wait_end(), 6)

        status, result = recorders.status, stack.result()
        self.assertEqual(status.phase, PHASE.COMPLETE.value)
        told = seconds_lost(status.lost, "the storage was full")
        self.assertEqual([*told], ["main/one", "second/two"])
        for platform, seconds in zip(PLATFORMS, told.values()):
            (missing,) = holes(recorders.received(platform))
            self.assertGreater(missing, 2.0 * RATE_HZ)
            self.assertLess(abs(seconds - missing / RATE_HZ), allowed_s(TOLD_WITHIN_S, began_s), status.lost)
        manifest = read_json(Path(status.location.replace(".bag", ".manifest.json"))) or {}
        self.assertEqual("; ".join(manifest["lost_in_flight"]), status.lost)
        self.assertEqual(
            {each: result[each] for each in ("result", "data", "data_result", "data_summary", "exit_status")},
            {
                "result": "COMPLETE",  # of the flight
                "data": status.location,
                "data_result": "INCOMPLETE",
                "data_summary": status.message,
                "exit_status": 6,
            },
        )
        self.assertTrue(status.message.endswith(f"verified; lost: {status.lost}"), status.message)
        self.assertEqual(
            (stack.states[-1].state, stack.states[-1].data_result, stack.states[-1].result),
            ("MISSION_ENDED", "INCOMPLETE", "COMPLETE"),
        )
        stack.check_laws()
        self.assert_all_is_for_user_and_group(recorders, stack)
        print(f"full in flight, with room again: exit status 6; {status.message}")

    def assert_all_is_for_user_and_group(self, recorders: Recorders, stack: Stack) -> None:
        """Assert it of all that a flight leaves: on the other platform, at the collector, of the engine."""
        session = Path(recorders.status.location).parent
        wait_for((session / "flight.html").is_file, "the page", 120.0)
        there, here = (assert_modes(folder) for folder in reversed(recorders.written_in))
        part = {"two-01.bag", "two-02.bag", "two.log", "parts.json"}
        self.assertEqual({path.name for path in there}, {".recorder-second.json", ".recorder-second.lock", *part})
        self.assertEqual({path.name for path in here if path.parent.name == "second"}, part)
        whole = {f"{session.name}.bag", f"{session.name}.manifest.json", "flight.html", "journal.jsonl"}
        self.assertEqual({path.name for path in here if path.parent == session}, whole)
        made = {".recorder-main.json", "one-01.bag", "one-02.bag", "one.log", "effective.json"}
        self.assertLessEqual(made, {path.name for path in here})
        engine = {path.name for path in stack.check_modes()}
        self.assertEqual(engine, {"journal.jsonl", "report.txt", "result.json"})

    def test_a_power_cut_at_a_random_moment_takes_at_most_a_second_and_a_half(self) -> None:
        lost_s = [each / RATE_HZ for each in self.lost_by_cuts("cut", CUTS)]
        words = ", ".join(f"{each:.2f}" for each in lost_s)
        print(f"{CUTS} power cuts, two bags each: lost {words} s (limit {LOST_BY_A_CUT_S} s)")
        self.assertLess(max(lost_s), LOST_BY_A_CUT_S, words)

    @unittest.skipUnless(is_drawn("cut of a slow group"), ANOTHER_TIME)
    def test_of_a_group_with_a_message_a_second_a_power_cut_takes_the_last_one_too(self) -> None:
        """Rosbag hands the end of a message to the kernel when the next one of its bag comes."""
        cuts = max(1, CUTS // 3)
        lost = self.lost_by_cuts("slow", cuts, size=20, rate_hz=1)
        print(f"{cuts} power cuts, two bags each with a message of 25 bytes a second: lost {lost} messages")
        self.assertLessEqual(max(lost), MESSAGES_LOST_BY_A_CUT, lost)

    @unittest.skipUnless(is_drawn("cut of a compressed bag"), ANOTHER_TIME)
    def test_of_a_compressed_bag_a_power_cut_takes_the_chunk_that_is_open_too(self) -> None:
        cuts = max(1, CUTS // 3)
        lost = self.lost_by_cuts("lz4", cuts, size=400, compression="lz4", at_least_s=3.0)  # some chunks are closed
        lost_s = [each / RATE_HZ for each in lost]
        limit_s = LOST_BY_A_CUT_S + LZ4_CHUNK_BYTES / (400 * RATE_HZ)
        words = ", ".join(f"{each:.2f}" for each in lost_s)
        print(f"{cuts} power cuts, two bags each, lz4, 80 kB/s: lost {words} s (limit {limit_s:.1f} s)")
        self.assertLess(max(lost_s), limit_s, words)

    def lost_by_cuts(
        self,
        name: str,
        cuts: int,
        size: int = 100,
        rate_hz: int = RATE_HZ,
        compression: str = "none",
        at_least_s: float = 0.0,
    ) -> List[int]:
        """Cut the power of both platforms at random moments; return how many messages each has lost each time."""
        memory = Path("/dev/shm")  # the image lies there: how busy the disk of this machine is does not matter
        folder = Path(tempfile.mkdtemp(prefix="amaze_cut_", dir=memory if memory.is_dir() else None))
        draw = random.Random(1)
        self.addCleanup(shutil.rmtree, folder, ignore_errors=True)
        disk = Ext4(folder)
        self.addCleanup(disk.unmount)
        lost: List[int] = []
        told: List[str] = []
        for number in range(cuts):
            recorders = self.recorders(
                f"{name}{number}", storage=disk.folder, size=size, rate_hz=rate_hz, compression=compression
            )
            for platform in PLATFORMS:
                recorders.start_node(platform)
            self.assertTrue(recorders.ask("start").accepted)
            recorders.wait_phase(PHASE.RECORDING)
            time.sleep(draw.uniform(0.5, 4.0) + 3 / rate_hz + at_least_s)  # some messages are recorded
            recorder_pids = [recorders.process(*each) for each in (("main", "one"), ("second", "two"))]
            sent = {platform: recorders.numbers[platform].sent for platform in PLATFORMS}
            disk.cut()
            for pid in (*(node.pid for node in recorders.nodes.values()), *recorder_pids):
                os.kill(pid, signal.SIGKILL)
            for node in recorders.nodes.values():
                wait_for_end(node)
            disk.restart()
            left = {each: self.left_of(disk.folder / each, f"/{name}{number}/{each}/numbers") for each in PLATFORMS}
            for platform, numbers in left.items():
                self.assertEqual(holes(numbers), [])
                lost.append(sent[platform] - 1 - max(numbers, default=-1))
            told.append(self.told_after_a_cut(recorders, left, rate_hz))
            recorders.close()
            for platform in PLATFORMS:
                shutil.rmtree(disk.folder / platform)
        print(f"said after the restart, the time without power with it: {'; '.join(told)}")
        return lost

    def told_after_a_cut(self, recorders: Recorders, left: Dict[str, Set[int]], rate_hz: int) -> str:
        """Start nodes on what a power cut has left, as a computer that is started anew; return what is said of it.

        The collector goes on with the session. What is missing between what is left and what is recorded then is told.
        """
        began_s = time.monotonic()
        for platform in PLATFORMS:
            memory = recorders.storage / platform / f".recorder-{platform}.json"
            content = read_json(memory)
            assert content is not None, "a node's memory is on the disk"
            memory.write_text(json.dumps({**content, "boot_id": "of the boot before"}))
            recorders.start_node(platform)
        seen = len(recorders.statuses)
        wait_for(lambda: len(recorders.statuses) > seen, "the collector's word", 60.0)
        recorders.wait_phase(PHASE.RECORDING)
        wait_for(lambda: all(each.growing for each in recorders.status.platforms), "growth on both platforms")
        for platform in recorders.status.platforms:
            self.assertRegex(platform.message, r"interrupted once")
        time.sleep(3 / rate_hz)
        self.assertTrue(recorders.ask("stop").accepted)
        status = recorders.wait_phase(PHASE.COMPLETE)
        gaps = [each for each in status.lost.split("; ") if not each.endswith(" messages")]  # of a chunk cut in two
        said = seconds_lost("; ".join(gaps), "its computer was started anew")
        self.assertEqual([*said], ["main/one", "second/two"])
        manifest = read_json(Path(status.location.replace(".bag", ".manifest.json"))) or {}
        self.assertEqual("; ".join(manifest["lost_in_flight"]), status.lost)
        self.assertTrue(status.message.endswith(f"verified; lost: {status.lost}"), status.message)
        for platform, seconds in zip(PLATFORMS, said.values()):
            numbers = recorders.received(platform)
            self.assertLessEqual(left[platform], numbers, "what was left is in it")
            if left[platform]:  # else nobody knows which number was the first
                missing_s = (min(numbers - left[platform]) - max(left[platform])) / rate_hz
                self.assertLess(
                    abs(seconds - missing_s), allowed_s(TOLD_WITHIN_S + 1 / rate_hz, began_s), (status.lost, missing_s)
                )
        return status.lost

    def left_of(self, folder: Path, topic: str) -> Set[int]:
        """Return the numbers that a power cut has left in the part of a platform; that stays as it is."""
        numbers: Set[int] = set()
        copy = Path(tempfile.mkdtemp(prefix="amaze_left_"))
        self.addCleanup(shutil.rmtree, copy, ignore_errors=True)
        folder = Path(shutil.copytree(folder, copy / folder.name))
        for part in {path.parent for path in folder.glob("*/*/*.bag*")}:
            close_parts(part, {"session_id": "s1", "platform": part.name})
            for bag in part.glob("*.bag"):
                with Recording(bag) as recording:
                    numbers |= {int(recording.message(each).data.split()[0]) for each in recording.entries(topic)}
        return numbers

    def test_clocks_that_are_three_seconds_apart_are_corrected_and_parts_removed_in_the_end_when_configured(
        self,
    ) -> None:
        recorders = self.recorders("clocks", keep="false")
        library = another_clock(recorders.folder)
        recorders.start_node("main")
        recorders.start_node("second", LD_PRELOAD=str(library))
        self.assertTrue(recorders.ask("start").accepted)
        recorders.wait_phase(PHASE.RECORDING)
        time.sleep(1.0)  # so much is recorded
        self.assertTrue(recorders.ask("stop").accepted)
        status = recorders.wait_phase(PHASE.COMPLETE)
        manifest = read_json(Path(status.location.replace(".bag", ".manifest.json"))) or {}
        clock = manifest["platforms"]["second"]["clock"]
        for when in ("start", "stop"):
            self.assertLess(abs(clock[when]["offset_ns"] - 3_000_000_000), 20_000_000, clock)
        with Recording(Path(status.location)) as recording:
            ends = {topic.name.split("/")[2]: topic.last_ns for topic in recording.topics}
        self.assertLess(abs(ends["main"] - ends["second"]), 1_000_000_000, "record times were not corrected")
        self.assertTrue(manifest["verified"]["ok"])
        wait_for(lambda: [*recorders.storage.rglob("*.bag")] == [Path(status.location)], "the removal of the parts")
        costs = re.findall(r"main: (put on the disk [1-9].*)", recorders.log())
        self.assertEqual(len(costs), 1, "what it costs is said")
        print(f"open bags: {costs[0]}")
        print(f"clocks 3 s apart: measured {[clock[each]['offset_ns'] / 1e9 for each in ('start', 'stop')]} s")


def make_room(folder: Path) -> None:
    """Enlarge a small storage."""
    subprocess.run(["mount", "-o", "remount,size=400m", str(folder)], check=True, timeout=60)


def seconds_lost(told: str, cause: str) -> Dict[str, float]:
    """Return for how many seconds nothing was recorded, by platform and group, of losses that have all this cause."""
    found: Dict[str, float] = {}
    for each in told.split("; "):
        match = re.fullmatch(rf"(\w+/\w+): (\d+\.\d) s, in which nothing was recorded \({cause}\)", each)
        assert match is not None, f"{each!r} in {told!r}"
        found[match[1]] = float(match[2])
    return found


def _state(session: str, *, in_flight: bool) -> Any:
    state = msg.AutonomyState(session_id=session, in_flight=in_flight)
    state.header.stamp = rospy.Time.now()
    return state


def _jobs_of(pid: int) -> Set[int]:
    """Return the children of a process that work on bags."""
    children = [_read(path) for path in Path(f"/proc/{pid}/task").glob("*/children")]
    found = [int(word) for words in children for word in words.split()]
    return {each for each in found if b"recording.job" in _read(Path(f"/proc/{each}/cmdline"))}


def _read(path: Path) -> bytes:
    """Return what /proc says, which is nothing when the process or thread has just ended."""
    try:
        return path.read_bytes()
    except OSError:
        return b""


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("recorder_test")
    rostest.rosrun("amaze_autonomy", "recorder", TestRecorder)
