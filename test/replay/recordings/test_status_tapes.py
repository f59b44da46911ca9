"""Recorded statuses from a tape are those of the bag; what cannot be one is left to those who read it one by one."""

from __future__ import annotations

import pytest
from replay_bags import START_NS, S, number, write_bag
from replay_demo import MESSAGES, demo_bag, simulated
from replay_runs import replay

from amaze_autonomy.bags import Recording
from amaze_autonomy.engine import events
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.replay.recordings import statuses
from amaze_autonomy.replay.recordings.sources import Recordings
from amaze_autonomy.replay.recordings.statuses import EVENT_OF, taped_statuses

STATUSES = {
    "/mission_planner/status": "mission_planner",
    "/watchdog/info": "watchdog_info",
    "/data_recorder/status": "data_recorder",
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return demo_bag(tmp_path_factory.mktemp("bag") / "x.bag", simulated())


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Tapes are wanted."""
    monkeypatch.setenv("AMAZE_TAPES", str(tmp_path / "tapes"))
    return tmp_path / "tapes"


def taped(path, topic, name):
    with Recording(path) as recording:
        return taped_statuses(recording, topic, name)


@pytest.mark.parametrize("topic", list(STATUSES))
def test_the_tape_says_what_the_bag_says(bag, monkeypatch, topic):
    with Recording(bag) as recording:
        expected = [EVENT_OF[STATUSES[topic]](recording.message(e), e.t_ns) for e in recording.entries(topic)]
    assert len(expected) > 5
    assert taped(bag, topic, STATUSES[topic]) == expected
    monkeypatch.setattr(Recording, "message", None)  # nobody reads the bag
    assert taped(bag, topic, STATUSES[topic]) == expected


def test_a_tape_that_is_damaged_is_made_anew(bag, folder):
    expected = taped(bag, "/watchdog/info", "watchdog_info")
    for path in folder.glob("*/*.npz"):
        path.write_bytes(path.read_bytes()[:-100])
    assert taped(bag, "/watchdog/info", "watchdog_info") == expected


def test_another_code_is_another_tape(bag, folder, monkeypatch):
    taped(bag, "/watchdog/info", "watchdog_info")
    before = set(folder.glob("*/*.npz"))
    monkeypatch.setattr(statuses, "_code", lambda: "another")
    taped(bag, "/watchdog/info", "watchdog_info")
    assert len(set(folder.glob("*/*.npz")) - before) == 1


def test_without_tapes_nothing_is_read_beforehand(bag, monkeypatch):
    monkeypatch.delenv("AMAZE_TAPES")
    assert taped(bag, "/watchdog/info", "watchdog_info") is None


def test_the_watchdog_that_has_beaten_is_known_by_message_and_by_tape(tmp_path):
    callers = ("/near/watchdog", "/far/watchdog", "/near/watchdog")
    rows = []
    for step, caller in enumerate(callers):
        beat = events.WatchdogAction(t_ns=S, sequence=step, loop_counter=step, code=Code.NOMINAL)
        _, message = MESSAGES[events.WatchdogAction](beat, START_NS + step * S)
        rows.append((START_NS + step * S, "/watchdog/action", message, caller))
    path = write_bag(tmp_path / "x.bag", rows)
    found = taped(path, "/watchdog/action", "watchdog_action")
    assert [event.publisher for event in found] == list(callers)
    with Recordings([path], ["/watchdog/action"]) as bags:
        read = EVENT_OF["watchdog_action"]
        assert [read(bags.message(sample), sample.t_ns) for sample in bags.samples] == found
        assert bags.read_statuses({0: "watchdog_action"}) == (0,)
        assert [bags.status(sample) for sample in bags.samples] == found


def test_messages_that_are_no_statuses_are_left_alone(tmp_path, folder):
    path = write_bag(tmp_path / "x.bag", [(START_NS + n * S, "/a", number(n)) for n in range(3)])
    assert taped(path, "/a", "autopilot") is None
    assert not list(folder.glob("*/*.npz"))


def test_a_replay_from_tapes_decodes_nothing_and_decides_the_same(bag, monkeypatch, tmp_path):
    outcomes, decoded = [], []
    inner = Recordings.message
    monkeypatch.setattr(Recordings, "message", lambda self, sample: decoded.append(sample.rank) or inner(self, sample))
    for tapes in ("", str(tmp_path / "t"), str(tmp_path / "t")):
        monkeypatch.setenv("AMAZE_TAPES", tapes)
        decoded.clear()
        outcomes.append((replay(bag, "amaze_demo")[0], len(set(decoded))))
    assert outcomes[0][0] == outcomes[1][0] == outcomes[2][0]
    assert [each for _, each in outcomes] == [
        5,
        5,
        5,
    ]  # the journal, and the autopilot's, which tells of its sensors, too
