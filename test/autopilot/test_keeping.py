"""What outlives its process: the origin of a session, the time stamp of signatures."""

from __future__ import annotations

import json
import threading
from types import SimpleNamespace

import pytest
from autopilot_tools import beat
from flying import BACK, Flying, S

from amaze_autonomy.autopilot.errors import KeyFileError
from amaze_autonomy.autopilot.link import state_files
from amaze_autonomy.autopilot.link.state_files import StampFile, keep, origin_from, origin_to, read_kept
from amaze_autonomy.autopilot.link.wire import Wire, time_stamp
from amaze_autonomy.autopilot.planner.loading import Origin
from amaze_autonomy.autopilot.planner.sequencer import Sequencer
from amaze_autonomy.engine.events import MissionPhase
from amaze_autonomy.missions import Home

KEY = bytes(range(32))
NOW_NS = 1_800_000_000 * S
LIMIT_S = 60.0


@pytest.mark.parametrize(
    "origin", [Origin("s1", home=Home(47.4, 8.5)), Origin("s1", local=(1.0, -2.0, 0.5), boot_ns=NOW_NS)]
)
def test_an_origin_comes_back_as_it_was_kept(tmp_path, origin):
    keep(tmp_path / "new" / "planner.json", origin_to(origin))
    assert origin_from(read_kept(tmp_path / "new" / "planner.json")) == origin
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["planner.json"]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[1]",
        '{"session_id": ""}',
        '{"session_id": 3, "home": [1, 2]}',
        '{"session_id": "s1"}',
        '{"session_id": "s1", "home": [1, NaN]}',
        '{"session_id": "s1", "home": "47"}',
        '{"session_id": "s1", "local": [1, 2, 3], "boot_ns": null}',
    ],
)
def test_what_is_damaged_or_says_too_little_is_no_origin(tmp_path, text):
    (tmp_path / "planner.json").write_text(text)
    assert origin_from(read_kept(tmp_path / "planner.json")) is None
    assert origin_from(read_kept(tmp_path / "none.json")) is None


def started_again(flying):
    """Put a new planner in the place of the old one, with what was kept of it."""
    kept = json.loads(json.dumps(origin_to(flying.planner._loading.origin)))
    flying.planner = flying.channel.client = Sequencer(flying.planner._settings, origin_from(kept))
    flying.run(3 * S)


@pytest.mark.parametrize("mission", ["both", "inside twice"])
def test_a_planner_that_is_started_again_between_two_files_goes_on(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until_phase(MissionPhase.LANDED)
    started_again(flying)
    flying.take_off(mission, 1)
    flying.until_phase(MissionPhase.LANDED)
    last = BACK.waypoints[-1]
    assert flying.status.waypoint == 2
    assert flying.craft.position_m[:2] == pytest.approx((last.x_m, last.y_m), abs=0.6)


def test_the_origin_of_another_session_is_none_of_ours():
    flying = Flying()
    flying.take_off("both")
    flying.until_phase(MissionPhase.LANDED)
    started_again(flying)
    assert flying.load("both", 1, session="s2").reason == "the place of the session's first takeoff is not known"


def test_the_local_frame_of_an_autopilot_that_was_started_again_is_another_one():
    flying = Flying()
    flying.take_off("inside twice")
    flying.until_phase(MissionPhase.LANDED)
    flying.vehicle.px4._start_ns = flying.t_ns  # it begins to count anew
    flying.run(S)
    words = "the autopilot was started again since the session's first takeoff: its local frame counts no more"
    assert flying.load("inside twice", 1).reason == words


@pytest.mark.parametrize("step_s", [-3600.0, 6.0])
def test_a_wall_clock_that_is_set_between_two_files_is_no_restart_of_the_autopilot(step_s):
    flying = Flying()
    flying.take_off("inside twice")
    flying.until_phase(MissionPhase.LANDED)
    flying.planner._wall = lambda: round(step_s * S)
    loading = flying.load("inside twice", 1)
    assert (loading.accepted, loading.reason) == (True, "")


# --- the time stamp of signatures -------------------------------------------------------------------------------------


def signed(path, unix_ns):
    """Return the time stamp of a frame that a process signs which has just been started."""
    wire = Wire(1, 191, key=KEY, stamps=StampFile(path))
    raw = wire.send(beat(), unix_ns)
    return int.from_bytes(raw[-12:-6], "little"), wire


def test_the_time_stamp_grows_over_a_restart_whatever_the_clock_says(tmp_path):
    first, _ = signed(tmp_path / "stamp", NOW_NS)
    assert first == time_stamp(NOW_NS)
    killed, _ = signed(tmp_path / "stamp", 0)  # no battery behind its clock: 1970 again
    assert first < killed <= first + 31 * 100_000
    again, wire = signed(tmp_path / "stamp", NOW_NS - 3600 * S)
    assert again > killed
    wire.verifier.close()
    assert signed(tmp_path / "stamp", 0)[0] == again + 1


def test_the_vehicle_is_believed_after_a_restart(tmp_path):
    signed(tmp_path / "stamp", NOW_NS)
    _, ours = signed(tmp_path / "stamp", NOW_NS)
    assert len(ours.receive(Wire(1, 1, key=KEY).send(beat(), NOW_NS), None, NOW_NS)) == 1


@pytest.fixture
def disk(monkeypatch):
    """Return a disk that hangs as long as `goes_on` is not set; `began` counts its writes."""
    made = SimpleNamespace(goes_on=threading.Event(), began=threading.Semaphore(0), ended=threading.Semaphore(0))
    made.goes_on.set()

    def hangs(path, value):
        made.began.release()
        assert made.goes_on.wait(LIMIT_S)
        keep(path, value)
        made.ended.release()

    monkeypatch.setattr(state_files, "keep", hangs)
    yield made
    made.goes_on.set()


def test_the_file_is_written_ahead_and_not_with_each_frame(tmp_path, disk):
    _, wire = signed(tmp_path / "stamp", NOW_NS)
    assert all(disk.ended.acquire(timeout=LIMIT_S) for _ in range(2)), "the try, and what the first frame reserves"
    for second in range(60):
        wire.send(beat(), NOW_NS + second * S)
        if second in (16, 32, 48):
            assert disk.ended.acquire(timeout=LIMIT_S), second
        ahead = read_kept(tmp_path / "stamp")["time_stamp"] - time_stamp(NOW_NS + second * S)
        assert 0 < ahead <= 30 * 100_000
    assert not disk.ended.acquire(blocking=False)
    wire.verifier.close()
    assert read_kept(tmp_path / "stamp")["time_stamp"] == time_stamp(NOW_NS + 59 * S)


def test_no_message_needs_a_thread_that_may_not_be_had(tmp_path, monkeypatch):
    stamps = StampFile(tmp_path / "stamp")

    def start(_thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    stamps.use(time_stamp(NOW_NS))
    assert read_kept(tmp_path / "stamp")["time_stamp"] > time_stamp(NOW_NS)


def test_a_disk_that_hangs_holds_up_no_message(tmp_path, disk, monkeypatch):
    monkeypatch.setattr(state_files, "_CLOSE_LIMIT_S", 0.01)
    _, wire = signed(tmp_path / "stamp", NOW_NS)
    disk.goes_on.clear()
    assert all(disk.began.acquire(timeout=LIMIT_S) for _ in range(2))
    sent = [wire.send(beat(), NOW_NS + second * S) for second in range(300)]  # none waits
    assert disk.began.acquire(timeout=LIMIT_S)
    assert len({raw[-12:-6] for raw in sent}) == len(sent)
    wire.verifier.close()  # nor does its end
    disk.goes_on.set()
    assert disk.ended.acquire(timeout=LIMIT_S)


@pytest.mark.parametrize("text", ["", "x", '{"time_stamp": -1}', '{"time_stamp": "7"}', f'{{"time_stamp": {1 << 60}}}'])
def test_a_damaged_file_begins_with_the_clock(tmp_path, text):
    (tmp_path / "stamp").write_text(text)
    assert signed(tmp_path / "stamp", NOW_NS)[0] == time_stamp(NOW_NS)


def test_a_file_that_cannot_be_kept_is_told_at_the_start(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(KeyFileError, match=r"stamp: .*; the time stamp of signatures is kept there: permit it"):
        StampFile(tmp_path / "file" / "stamp")
