"""How fast bags are merged, recovered and looked into, against other tools on the same files in the same run.

    python test/bench/bags_speed.py [--seconds 20] [--folder FOLDER] [--copies 1]

Writes camera recordings (25 MB/s) and recordings of small messages of two computers into a folder below FOLDER
(default: memory), measures, prints a table in Markdown, and removes all of it. Each tool runs in a process of its own,
its start included; the best of three rounds counts, the rounds are interleaved. Tools that are not installed are left
out and named. The C++ programs are compiled here, with librosbag-dev.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "src"))

START_NS = 1_600_000_000_000_000_000
SECOND = 1_000_000_000
ROUNDS = 3
IMAGE = 1_000_000
LIMIT_S = 1800.0  # of one run: what takes longer hangs
HEADER = struct.Struct("<IIII")

CPP_MERGE = r"""
#include <rosbag/bag.h>
#include <rosbag/view.h>
int main(int argc, char** argv) {
  rosbag::Bag out(argv[1], rosbag::bagmode::Write);
  if (argc > 2 && argv[2][0] == '-') out.setCompression(rosbag::compression::LZ4);
  std::vector<std::shared_ptr<rosbag::Bag>> in;
  rosbag::View view;
  for (int i = argv[2][0] == '-' ? 3 : 2; i < argc; ++i) {
    in.push_back(std::make_shared<rosbag::Bag>(argv[i], rosbag::bagmode::Read));
    view.addQuery(*in.back());
  }
  for (const rosbag::MessageInstance& m : view) out.write(m.getTopic(), m.getTime(), m, m.getConnectionHeader());
  out.close();
}
"""
CPP_RECORD = r"""
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <signal.h>
int main(int argc, char** argv) {  // writes a bag again, and is killed when it has written a given number of messages
  rosbag::Bag in(argv[2], rosbag::bagmode::Read), out(argv[1], rosbag::bagmode::Write);
  std::string kind = argv[3];
  if (kind == "lz4") out.setCompression(rosbag::compression::LZ4);
  if (kind == "bz2") out.setCompression(rosbag::compression::BZ2);
  out.setChunkThreshold(atoi(argv[4]) * 1024);
  long left = atol(argv[5]);
  rosbag::View view(in);
  for (const rosbag::MessageInstance& m : view) {
    out.write(m.getTopic(), m.getTime(), m, m.getConnectionHeader());
    if (--left == 0) raise(SIGKILL);
  }
}
"""
CPP_READ = r"""
#include <rosbag/bag.h>
#include <rosbag/view.h>
int main(int argc, char** argv) {  // reads bags as `rosbag play` does: all of them in order of time
  std::vector<std::shared_ptr<rosbag::Bag>> in;
  rosbag::View view;
  for (int i = 1; i < argc; ++i) {
    in.push_back(std::make_shared<rosbag::Bag>(argv[i], rosbag::bagmode::Read));
    view.addQuery(*in.back());
  }
  std::vector<uint8_t> buffer;
  for (const rosbag::MessageInstance& m : view) {
    buffer.resize(m.size());
    ros::serialization::OStream stream(buffer.data(), buffer.size());
    m.write(stream);
  }
}
"""
# bag.h wants a header of another package for one member, its last but one; only the library itself ever uses that.
SHIM = """
#pragma once
#include <string>
namespace pluginlib {
template <class T> struct ClassLoader { char opaque[4096]; ClassLoader(const std::string&, const std::string&) {} };
}
"""
PY_READ = """
import sys, rosbag
for path in sys.argv[1:]:
    for message in rosbag.Bag(path).read_messages(raw=True):
        pass
"""
PY_MERGE = """
import sys, rosbag
bags = [rosbag.Bag(path) for path in sys.argv[2:]]
out = rosbag.Bag(sys.argv[1], "w")
rows = [bag.read_messages() for bag in bags]
import heapq
for topic, message, t in heapq.merge(*rows, key=lambda row: row[2]):
    out.write(topic, message, t)
out.close()
"""


def stamp(t_ns: int, seq: int) -> bytes:
    return HEADER.pack(seq, t_ns // SECOND, t_ns % SECOND, 0)


def write_small(path: Path, computer: str, seconds: int) -> None:
    """Write IMU and range messages of one computer, 430 a second."""
    chance = random.Random(computer)
    with Recorder(path) as recorder:
        streams = [(recorder.topic(f"/{computer}/imu{each}", "sensor_msgs/msg/Imu"), 200, 296) for each in (0, 1)]
        streams.append((recorder.topic(f"/{computer}/range", "sensor_msgs/msg/Range"), 30, 17))
        shift = chance.randrange(400_000)
        events = sorted(
            (START_NS + shift + each * SECOND // rate_hz + place * 999, each, place)
            for place, (_, rate_hz, _) in enumerate(streams)
            for each in range(seconds * rate_hz)
        )
        for t_ns, each, place in events:
            connection, _, size = streams[place]
            recorder.write(connection, t_ns, stamp(t_ns, each) + chance.getrandbits(8 * size).to_bytes(size, "little"))


def write_camera(path: Path, computer: str, seconds: int) -> None:
    """Write 25 images of a megabyte, and 200 IMU messages, a second."""
    chance = random.Random(computer)
    half = chance.getrandbits(IMAGE).to_bytes(IMAGE // 8, "little")
    image = (half + bytes(IMAGE // 8)) * 4  # lz4 makes half of it
    body = struct.pack("<III", 1000, 1000, 5) + b"mono8" + struct.pack("<BII", 0, 1000, IMAGE) + image
    with Recorder(path) as recorder:
        camera = recorder.topic(f"/{computer}/image", "sensor_msgs/msg/Image")
        imu = recorder.topic(f"/{computer}/imu", "sensor_msgs/msg/Imu")
        shift = chance.randrange(4_000_000)
        for each in range(seconds * 25):
            t_ns = START_NS + shift + each * SECOND // 25
            recorder.write(camera, t_ns, stamp(t_ns, each) + body)
            for step in range(8):
                at_ns = t_ns + 1000 + step * SECOND // 200
                recorder.write(imu, at_ns, stamp(at_ns, each * 8 + step) + bytes(296))


class Recorder:
    """Writes a bag; in a process of its own, so that the one that measures stays small."""

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag1 import Writer  # noqa: PLC0415
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

        self._writer, self._store = Writer(path), get_typestore(Stores.ROS1_NOETIC)
        self.write = self._writer.write

    def __enter__(self) -> Recorder:  # noqa: PYI034
        self._writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def topic(self, name: str, kind: str) -> object:
        return self._writer.add_connection(name, kind, typestore=self._store, callerid=name, latching=0)


def apart(function: object, *arguments: object) -> None:
    """Call a function in a process of its own."""
    child = os.fork()
    if child:
        assert os.waitpid(child, 0)[1] == 0
        return
    try:
        function(*arguments)
        os._exit(0)
    finally:
        os._exit(1)


def ours(*arguments: object) -> None:
    command = [sys.executable, "-m", "amaze_autonomy.bags.cli", *map(str, arguments)]
    subprocess.run(
        command,
        check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        stdout=subprocess.DEVNULL,
        timeout=LIMIT_S,
    )


def repack(path: Path, kind: str, programs: dict) -> None:
    """Write a bag again as the recorder does with --lz4 --chunksize=64; the rosbags library's lz4 is another."""
    packed = path.with_suffix(".packed.bag")
    if "record" in programs:
        subprocess.run(
            list(map(str, (programs["record"], packed, path, kind, 64, 1 << 40))), check=True, timeout=LIMIT_S
        )
    else:
        ours("merge", path, "-o", packed, "--compression", kind)
    packed.replace(path)


def timed(command: list, synced: Path | None = None, *, may_fail: bool = False) -> tuple[float, float, float]:
    """Return seconds, seconds of computing, and megabytes of a process; until a file that it wrote is on the disk."""
    before = time.perf_counter()
    process = subprocess.Popen(
        [str(part) for part in command],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    error = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status and not may_fail:
        sys.exit(f"{command[0]} failed: {error.decode()[-400:]}")
    if synced and synced.is_file():
        file = os.open(synced, os.O_RDONLY)
        os.fsync(file)
        os.close(file)
    return time.perf_counter() - before, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def compare(tools: dict, output: Path) -> dict:
    """Return the best seconds, computing and memory of each tool; a tool is a list of commands that do one job."""
    best = {}
    for _ in range(ROUNDS):
        for name, commands in tools.items():
            seconds, cpu, memory = 0.0, 0.0, 0.0
            for command in commands:
                took_s, cpu_s, used = timed(command, command[-1] if name == "cp" else output)
                seconds, cpu, memory = seconds + took_s, cpu + cpu_s, max(memory, used)
            best[name] = tuple(map(min, best.get(name, (9e9, 9e9, 9e9)), (seconds, cpu, memory)))
            for path in output.parent.glob(f"{output.stem}*"):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
    return best


def table(title: str, best: dict, base: str) -> None:
    print(f"\n{title}\n\n| Tool | Time | Computing | Memory | Time, times {base} |\n|---|---|---|---|---|")
    for name, (seconds, cpu, memory) in best.items():
        print(f"| {name} | {seconds:.2f} s | {cpu:.2f} s | {memory:.0f} MB | {seconds / best[base][0]:.2f} |")


def merge_tools(inputs: list, output: Path, programs: dict, compression: str = "auto") -> dict:
    merge = [sys.executable, "-m", "amaze_autonomy.bags.cli", "merge", *inputs, "-o", output, "--force"]
    copies = [output.with_name(f"{output.stem}{each}.copy") for each in range(len(inputs))]
    tools = {
        "cp": [["cp", source, copy] for source, copy in zip(inputs, copies)],
        "amaze-bag merge": [[*merge, "--compression", compression]],
    }
    if "merge" in programs:
        packed = ["-lz4"] if compression == "lz4" else []
        tools["librosbag (C++)"] = [[programs["merge"], output, *packed, *inputs]]
    converter = Path(sys.executable).with_name("rosbags-convert")
    if converter.exists() and compression == "auto":
        tools["rosbags-convert"] = [[converter, "--src", *inputs, "--dst", output]]
    if programs.get("python"):
        tools["rosbag in Python"] = [[programs["python"], "-c", PY_MERGE, output, *inputs]]
    return tools


def reading(inputs: list, output: Path, programs: dict) -> None:
    """Measure how long others take to read a merged bag, against its inputs."""
    ours("merge", *inputs, "-o", output)
    print(f"\n| Read {output.stat().st_size / 1e6:.0f} MB, merged | The inputs | The merged bag |\n|---|---|---|")
    tools = {"librosbag (C++)": [programs["read"]]} if "read" in programs else {}
    if "python" in programs:
        tools["rosbag in Python"] = [programs["python"], "-c", PY_READ]
    for name, command in tools.items():
        best = [min(timed([*command, *paths])[0] for _ in range(ROUNDS)) for paths in (inputs, [output])]
        print(f"| {name} | {best[0]:.2f} s | {best[1]:.2f} s |")
    output.unlink()


def compiled(folder: Path) -> dict:
    programs = {}
    (folder / "shim" / "pluginlib").mkdir(parents=True)
    (folder / "shim" / "pluginlib" / "class_loader.hpp").write_text(SHIM)
    for name, text in (("merge", CPP_MERGE), ("record", CPP_RECORD), ("read", CPP_READ)):
        source, program = folder / f"{name}.cpp", folder / name
        source.write_text(text)
        libraries = [
            f"-l{each}"
            for each in ("rosbag_storage", "roscpp_serialization", "rostime", "cpp_common", "roscpp", "console_bridge")
        ]
        command = ["g++", "-O2", "-w", "-idirafter", folder / "shim", source, "-o", program, *libraries]
        words = list(map(str, command))
        if (
            shutil.which("g++")
            and not subprocess.run(words, check=False, capture_output=True, timeout=LIMIT_S).returncode
        ):
            programs[name] = program
        else:
            print(f"not compiled, so left out: {name}.cpp with librosbag")
    if shutil.which("rosbag"):
        programs["python"] = "/usr/bin/python3"
    return programs


def recovery(folder: Path, source: Path, programs: dict, kind: str, chunk_kb: int, messages: int) -> None:
    """Kill a recorder in C++ and compare what is recovered."""
    active = folder / "killed.bag.active"
    command = [programs["record"], active, source, kind, chunk_kb, messages]
    assert subprocess.run(list(map(str, command)), check=False, timeout=LIMIT_S).returncode == -signal.SIGKILL
    os.sync()
    recover = [sys.executable, "-m", "amaze_autonomy.bags.cli", "recover", "--force"]
    recovered, work = folder / "killed.bag", folder / "reindexed.bag"
    shutil.copy(active, work)
    ours_s = timed([*recover, active], recovered, may_fail=True)[0]
    theirs_s = timed(["rosbag", "reindex", "-q", work], work, may_fail=True)[0]
    kept = [in_process("count", path)[1] for path in (recovered, work)]
    recovered.unlink()
    here_s, there_s = in_process("in_place", active)[0], timed([*recover, "--in-place", active], may_fail=True)[0]
    print(
        f"| {source.stem}, {kind}, {chunk_kb} kB chunks | {work.stat().st_size / 1e6:.0f} MB | "
        f"{messages - kept[0]} | {messages - kept[1]} | {ours_s:.2f} s | {there_s:.2f} s | {here_s:.3f} s | "
        f"{theirs_s:.2f} s |"
    )
    for path in (*folder.glob("killed*"), *folder.glob("reindexed*")):
        path.unlink()


SCRIPTS = {
    "count": "from amaze_autonomy.bags.index import Index\nwith Index(path) as index: n = len(index.messages().t_ns)",
    "in_place": (
        "from amaze_autonomy.bags.recover.recover import recover_in_place, restore\n"
        "done = recover_in_place(path); n = done.scan.messages; spent = time.perf_counter(); restore(done.path); "
        "began += time.perf_counter() - spent"
    ),
}


def in_process(what: str, path: Path) -> tuple[float, int]:
    """Return how long something takes in a process that has already loaded everything, and its count of messages."""
    lines = SCRIPTS[what].splitlines()
    script = (
        f"import time; from pathlib import Path; path = Path({str(path)!r}); {lines[0]}\n"
        f"best = 9e9\nfor _ in range({ROUNDS}):\n    began = time.perf_counter()\n    {lines[1]}\n"
        "    best = min(best, time.perf_counter() - began)\nprint(best, n)"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, env=environment, timeout=LIMIT_S
    )
    seconds, count = done.stdout.split()
    return float(seconds), int(count)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--seconds", type=int, default=20, help="of camera recording; small messages last 15 times that"
    )
    parser.add_argument("--folder", type=Path, default=Path("/dev/shm"), help="where; memory by default")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder, prefix="bags_speed-") as name:
        run(Path(name), options.seconds)


def run(folder: Path, seconds: int) -> None:
    programs = compiled(folder)
    output = folder / "out.bag"
    small = [folder / f"small{each}.bag" for each in "12"]
    for each, path in enumerate(small):
        apart(write_small, path, f"computer_{'x' * each}", 15 * seconds)
    size = sum(path.stat().st_size for path in small) / 1e6
    best = compare(merge_tools(small, output, programs), output)
    table(f"Small messages, {size:.0f} MB, {2 * 15 * seconds * 430:,} messages", best, "cp")
    took_s, found = in_process("count", small[0])
    print(f"\nIndex of {small[0].stat().st_size / 1e6:.0f} MB with {found:,} messages, in process: {took_s:.4f} s")
    for kind in ("none", "lz4"):
        camera = [folder / f"camera{each}.bag" for each in "12"]
        for each, path in enumerate(camera):
            apart(write_camera, path, f"computer_{'x' * each}", seconds)
            if kind != "none":
                repack(path, kind, programs)
        size = sum(path.stat().st_size for path in camera) / 1e6
        tools = merge_tools(camera, output, {key: programs[key] for key in programs if key != "python"})
        if kind == "lz4" and "merge" in programs:
            tools["librosbag (C++), lz4 again"] = [[programs["merge"], output, "-lz4", *camera]]
        table(f"Camera recordings, {kind}, {size:.0f} MB", compare(tools, output), "cp")
        reading(camera, output, programs)
        if kind == "none" and "record" in programs:
            print("\n| Killed | Size | Lost | By reindex | recover | in place | in process | rosbag reindex |")
            print("|---|---|---|---|---|---|---|---|")
            for chunks in (("none", 768), ("lz4", 768), ("lz4", 64), ("bz2", 768)):
                recovery(folder, small[0], programs, *chunks, 15 * seconds * 430 - 1234)
            for chunks in (("none", 768), ("lz4", 64)):
                recovery(folder, camera[0], programs, *chunks, seconds * 225 - 123)
        for path in camera:
            path.unlink()


if __name__ == "__main__":
    main()
