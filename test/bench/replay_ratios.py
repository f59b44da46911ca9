"""How fast a flight of ten minutes is replayed: against iteration by the rosbags library, with tapes, with images.

    python test/bench/replay_ratios.py [--repetitions 2] [--folder FOLDER]

Writes a flight by `flight_bag.py`, 280 s for each repetition of its survey, with and without images, plain and lz4.
Replays each by `amaze-replay run`, its result files included, in a process of its own, the best of five interleaved
rounds. Prints seconds of flight per second of computing: of the whole process with the start of Python, and of the
command alone, once all code is loaded. All must write the same journal.

"Plain iteration" is the same replay, as lean as it can be, of what the rosbags library iterates over: every message of
the bag is deserialised, in the order of the library, by the definitions in the bag; then each is handed to the monitors
by itself. Both are measured once more with a limit that the flight does not keep at any time, so that every look at
it has to be made. Then the engine alone, and the parts of a replay.
"""

from __future__ import annotations

import argparse
import gc
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "src"))
BASE = "plain iteration by rosbags"
OUTSIDE = ", out of a limit all the time"
LIMIT = ["--set", "sensors.state_estimation.tilt_limit_deg=0.001"]
MAP = ROOT / "test" / "bench" / "flight.yaml"
ROUNDS = 5

COMMAND = """
import sys, time
import rosbags.rosbag1, rosbags.typesys
from amaze_autonomy.tester.command import main

began = time.process_time()
status = main(sys.argv[1:])
sys.stderr.write(f"{time.process_time() - began}\\n")
raise SystemExit(status)
"""
PLAIN = """
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from amaze_autonomy.replay.monitors.monitors import Monitors
from amaze_autonomy.replay.recordings.sources import Recordings

def opened(self, paths, inner=Recordings._open):
    inner(self, paths)
    store, found = get_typestore(Stores.EMPTY), {}
    with Reader(paths[0]) as reader:
        for each in reader.connections:
            store.register(get_types_from_msg(getattr(each.msgdef, "data", each.msgdef), each.msgtype))
            found[each.topic] = []
        for connection, _, raw in reader.messages():
            found[connection.topic].append(store.deserialize_ros1(raw, connection.msgtype))
    self.next_of = {topic: iter(messages).__next__ for topic, messages in found.items()}
    self.looked_at = {}

def message(self, sample):
    if sample not in self.looked_at:  # the first ones are looked at to know how the recording begins, and then again
        self.looked_at[sample] = self.next_of[self.topics[sample.rank]]()
    return self.looked_at[sample]

Recordings._open = opened
Recordings.message = message
Monitors.light = lambda *_: None
Recordings.tell_statuses = Recordings.read = lambda *_: None
"""


def once(command: list, environment: dict) -> tuple[float, float]:
    """Return the computing of a process, and of the command in it."""
    process = subprocess.Popen(
        [str(part) for part in command], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    said = process.stderr.read().split()
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0, command
    return usage.ru_utime + usage.ru_stime, float(said[-1]) if said else 0.0


def measure(bags: dict, folder: Path) -> dict:
    """Return the best of both of each way."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    environment.pop("AMAZE_TAPES", None)
    out, best = folder / "out", {}
    rest = ["--map", MAP, "--mission", "4", "--no-html", "--out", out]
    ways = {f"cold, {name}": (COMMAND, bag, []) for name, bag in bags.items()}
    ways.update({f"warm, {name}": (COMMAND, bag, ["--tapes", folder / "tapes"]) for name, bag in bags.items()})
    ways[BASE] = (PLAIN + COMMAND, bags["plain"], [])
    ways[f"cold, plain{OUTSIDE}"] = (COMMAND, bags["plain"], LIMIT)
    ways[f"{BASE}{OUTSIDE}"] = (PLAIN + COMMAND, bags["plain"], LIMIT)
    hashes: dict = {True: set(), False: set()}
    for number in range(ROUNDS + 1):  # the first one fills the caches
        for name, (program, bag, more) in ways.items():
            took = once([sys.executable, "-c", program, "run", bag, *rest, *more], environment)
            hashes[more is LIMIT].add(hashlib.sha256((out / "journal.jsonl").read_bytes()).hexdigest())
            if number:
                best[name] = tuple(map(min, best.get(name, took), took))
    assert [len(each) for each in hashes.values()] == [1, 1], "the ways do not agree"
    return best


def parts(bag: Path) -> list:
    """Return what parts of a replay take in this process, computing only."""
    from amaze_autonomy.bags import Recording  # noqa: PLC0415
    from amaze_autonomy.config.loader import load_configuration  # noqa: PLC0415
    from amaze_autonomy.engine.events import Event  # noqa: PLC0415
    from amaze_autonomy.journal.journal import encode_event, read  # noqa: PLC0415
    from amaze_autonomy.paths import config_folder  # noqa: PLC0415
    from amaze_autonomy.replay.maps.topic_map import load_map  # noqa: PLC0415
    from amaze_autonomy.replay.plan import make_plan  # noqa: PLC0415
    from amaze_autonomy.replay.recordings.sources import Recordings  # noqa: PLC0415
    from amaze_autonomy.replay.session import Session  # noqa: PLC0415

    with Recording(bag) as recording:
        topics = tuple(topic.name for topic in recording.topics)
    plan = make_plan(load_configuration(config_folder()), load_map(str(MAP)), "4", topics)
    gc.disable()  # as `amaze-replay run` does
    laps, began = [], time.process_time()

    def lap(what: str) -> None:
        nonlocal began
        laps.append((what, time.process_time() - began))
        began = time.process_time()

    with Recordings([bag], plan.topics) as recordings:
        lap("index, order of the messages")
        session = Session(plan, recordings)
        session._lights()
        lap("numbers as columns")
        outcome = session.run()
        lap("monitors, peers, engine, journal")
    events = [line.payload for line in read("\n".join(outcome.journal) + "\n").lines if isinstance(line.payload, Event)]
    took = min(decided(events, plan.rules) for _ in range(ROUNDS))
    laps.append((f"of that, the engine: {len(events)} events, {len(events) / took:,.0f} a second", took))
    began = time.process_time()
    for event in events:
        encode_event(event)
    lap("of that, writing events as JSON")
    return laps


def decided(events: list, rules: object) -> float:
    """Return how long it takes to decide events."""
    from amaze_autonomy.engine.decide import decide  # noqa: PLC0415
    from amaze_autonomy.engine.state import EngineState  # noqa: PLC0415

    began, state = time.process_time(), EngineState()
    for event in events:
        state, _ = decide(state, event, rules)
    return time.process_time() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=2, help="of the survey, 280 s each")
    parser.add_argument("--folder", type=Path, default=Path("/dev/shm"), help="where; memory by default")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder, prefix="replay_ratios-") as name:
        run(Path(name), options.repetitions)


def run(folder: Path, repetitions: int) -> None:
    bags = {}
    for kind, more in (("plain", []), ("lz4", ["--compression", "lz4"]), ("with images", ["--images"])):
        bags[kind] = folder / f"{kind.replace(' ', '_')}.bag"
        program = [sys.executable, ROOT / "test" / "bench" / "flight_bag.py", bags[kind]]
        once([*program, "--repetitions", repetitions, *more], dict(os.environ))
    best = measure(bags, folder)
    result = json.loads((folder / "out" / "result.json").read_text())
    length_s = (result["end_ns"] - result["start_ns"]) / 1e9
    print(f"{length_s:.0f} s of flight, {sum(each['messages'] for each in result['topics'])} messages that are used\n")
    print("| Replay | Computing | Times real time | Times plain iteration | Process | Times real time |")
    print("|---|---|---|---|---|---|")
    for name, (process_s, command_s) in best.items():
        base_s = best[BASE + (OUTSIDE if OUTSIDE in name else "")][1]
        ratios = f"{length_s / command_s:,.0f} | {base_s / command_s:.1f}"
        print(f"| {name} | {command_s:.2f} s | {ratios} | {process_s:.2f} s | {length_s / process_s:,.0f} |")
    sizes = ", ".join(f"{name} {path.stat().st_size / 1e6:,.0f} MB" for name, path in bags.items())
    print(f"\nSizes: {sizes}")
    print("\n| Part, in process | Computing |\n|---|---|")
    for what, took_s in parts(bags["plain"]):
        print(f"| {what} | {took_s:.3f} s |")


if __name__ == "__main__":
    main()
