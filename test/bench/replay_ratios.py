"""How fast a flight of ten minutes is replayed: against iteration by the rosbags library, with tapes, with images.

    python test/bench/replay_ratios.py [--repetitions 2] [--folder FOLDER]

Writes a flight by `flight_bag.py`, 280 s for each repetition of its survey, with and without images, plain and lz4.
Replays each as a process of its own, its start included, the best of three interleaved rounds, and prints seconds of
flight per second, by the wall and by the computing of the process: on a busy machine only that says something. "plain
iteration" is the same replay with every message deserialised by the rosbags library, one by one. All must write the
same journal. Then the engine alone: decisions per second, and what each part of a replay takes.
"""

from __future__ import annotations

import argparse
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
MAP = ROOT / "test" / "bench" / "flight.yaml"
ROUNDS = 3

PLAIN = """
import sys
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from amaze_autonomy.bags.recording import Recording
from amaze_autonomy.replay.cli import main
from amaze_autonomy.replay.monitors import Monitors

messages = {}
def opened(self, path, inner=Recording.__init__):
    inner(self, path)
    if messages:
        return
    store = get_typestore(Stores.EMPTY)
    with Reader(path) as reader:
        for each in reader.connections:
            store.register(get_types_from_msg(getattr(each.msgdef, "data", each.msgdef), each.msgtype))
        for connection, t_ns, raw in reader.messages():
            messages.setdefault((connection.topic, t_ns), []).append(store.deserialize_ros1(raw, connection.msgtype))
def message(self, entry):
    return messages[self._links[entry.connection].topic, entry.t_ns][0]
Recording.__init__, Recording.message = opened, message
Monitors.light = lambda *_: None
raise SystemExit(main(sys.argv[1:]))
"""


def once(command: list, environment: dict) -> tuple[float, float]:
    began = time.perf_counter()
    process = subprocess.Popen([str(part) for part in command], env=environment, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0, command
    return time.perf_counter() - began, usage.ru_utime + usage.ru_stime


def measure(bags: dict, folder: Path) -> dict:
    """Return the best wall and computing seconds of each way, and the journal's hash."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    environment.pop("AMAZE_TAPES", None)
    out, best = folder / "out", {}
    rest = ["--map", MAP, "--mission", "4", "--out", out]
    ways = {name: ([sys.executable, "-m", "amaze_autonomy.replay.cli"], bag, []) for name, bag in bags.items()}
    for name in ("plain", "lz4"):
        warm = ["--tapes", folder / "tapes"]
        ways[f"{name}, with its tape"] = ([sys.executable, "-m", "amaze_autonomy.replay.cli"], bags[name], warm)
    ways["plain iteration by rosbags"] = ([sys.executable, "-c", PLAIN], bags["plain"], [])
    hashes = set()
    for number in range(ROUNDS + 1):  # the first one fills the caches
        for name, (program, bag, more) in ways.items():
            took = once([*program, "run", bag, *rest, *more], environment)
            hashes.add(hashlib.sha256((out / "journal.jsonl").read_bytes()).hexdigest())
            if number:
                best[name] = tuple(map(min, best.get(name, took), took))
    assert len(hashes) == 1, "the ways do not agree"
    return best


def parts(bag: Path) -> list:
    """Return what parts of a replay take in this process, computing only."""
    from amaze_autonomy.bags import Recording  # noqa: PLC0415
    from amaze_autonomy.config.loader import load_configuration  # noqa: PLC0415
    from amaze_autonomy.engine.decide import decide  # noqa: PLC0415
    from amaze_autonomy.engine.events import Event  # noqa: PLC0415
    from amaze_autonomy.engine.journal import encode_event, read  # noqa: PLC0415
    from amaze_autonomy.engine.state import EngineState  # noqa: PLC0415
    from amaze_autonomy.paths import config_folder  # noqa: PLC0415
    from amaze_autonomy.replay.plan import make_plan  # noqa: PLC0415
    from amaze_autonomy.replay.session import Session  # noqa: PLC0415
    from amaze_autonomy.replay.sources import Recordings  # noqa: PLC0415
    from amaze_autonomy.replay.topic_map import load_map  # noqa: PLC0415

    with Recording(bag) as recording:
        topics = tuple(topic.name for topic in recording.topics)
    plan = make_plan(load_configuration(config_folder()), load_map(str(MAP)), "4", topics)
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
    began = time.process_time()
    for _ in range(ROUNDS):
        state = EngineState()
        for event in events:
            state, _ = decide(state, event, plan.rules)
    laps.append((f"of that, the engine: {len(events)} events", (time.process_time() - began) / ROUNDS))
    began = time.process_time()
    for event in events:
        encode_event(event)
    lap("of that, writing events as JSON")
    return laps


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
    print("| Bag | Size | Time | Times real time | Computing | Times real time | Times as fast as plain iteration |")
    print("|---|---|---|---|---|---|---|")
    base = best["plain iteration by rosbags"][1]
    for name, (wall_s, cpu_s) in best.items():
        size = bags.get(name.split(",")[0], bags["plain"]).stat().st_size / 1e6
        ratios = f"{length_s / wall_s:.0f} | {cpu_s:.2f} s | {length_s / cpu_s:.0f} | {base / cpu_s:.1f}"
        print(f"| {name} | {size:.0f} MB | {wall_s:.2f} s | {ratios} |")
    print("\n| Part, in process | Computing |\n|---|---|")
    for what, took_s in parts(bags["plain"]):
        print(f"| {what} | {took_s:.3f} s |")


if __name__ == "__main__":
    main()
