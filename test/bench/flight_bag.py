"""A flight of ten minutes as the recorder of this package records it: the simulated world, with sensors at their rates.

    python test/bench/flight_bag.py OUTPUT.bag [--images] [--compression lz4]

A survey is flown twice in the simulated world. Its statuses and its journal are written as the nodes publish them, and
beside them what the sensors measure at that height, with noise: 445 messages a second, a quarter of a million. With
images, two cameras of 10 Hz and 100 kB an image are added.
"""

from __future__ import annotations

import argparse
import random
import struct
import sys
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "test" / "replay")]

from replay_bags import START_NS, STORE, S  # noqa: E402
from replay_demo import MESSAGES  # noqa: E402
from rosbags.rosbag1 import Writer  # noqa: E402

from amaze_autonomy.config.loader import load_configuration  # noqa: E402
from amaze_autonomy.engine.events import AutopilotStatus  # noqa: E402
from amaze_autonomy.journal.journal import read  # noqa: E402
from amaze_autonomy.paths import config_folder  # noqa: E402
from amaze_autonomy.simulation.run import run  # noqa: E402
from amaze_autonomy.simulation.scenario import Scenario  # noqa: E402

IMAGE = 100_000
_HEAD = struct.Struct("<IIII")


def head(t_ns: int, seq: int, frame: bytes = b"base_link") -> bytes:
    return _HEAD.pack(seq, t_ns // S, t_ns % S, len(frame)) + frame


def doubles(*values: float) -> bytes:
    return struct.pack(f"<{len(values)}d", *values)


class Sensors:
    """What each sensor writes, as bytes of its message."""

    def __init__(self, seed: int) -> None:
        self._chance = random.Random(seed)
        self._image = bytes(self._chance.choices(range(256), k=IMAGE // 4)) * 4

    def _noise(self, of: float) -> float:
        return self._chance.uniform(-of, of)

    def imu(self, t_ns: int, seq: int, _height: float) -> bytes:
        rates = [self._noise(0.01) for _ in "xyz"]
        force = self._noise(0.05), self._noise(0.05), 9.81 + self._noise(0.05)
        covariance = (0.0,) * 9
        return head(t_ns, seq) + doubles(0.0, 0.0, 0.0, 1.0, *covariance, *rates, *covariance, *force, *covariance)

    def odometry(self, t_ns: int, seq: int, height: float) -> bytes:
        covariance = [1e-4 if place % 7 == 0 else 0.0 for place in range(36)]
        pose = doubles(self._noise(0.01), self._noise(0.01), height, 0.0, 0.0, 0.0, 1.0, *covariance)
        child = b"base_link"
        return (
            head(t_ns, seq, b"odom") + struct.pack("<I", len(child)) + child + pose + doubles(*[0.0] * 6, *covariance)
        )

    def distance(self, t_ns: int, seq: int, height: float) -> bytes:
        return head(t_ns, seq) + struct.pack("<Bffff", 1, 0.01, 0.01, 40.0, height + 0.1 + self._noise(0.005))

    def magnetic(self, t_ns: int, seq: int, _height: float) -> bytes:
        return head(t_ns, seq) + doubles(2e-5, 0.0, 4e-5 + self._noise(1e-6), *[0.0] * 9)

    def pressure(self, t_ns: int, seq: int, height: float) -> bytes:
        return head(t_ns, seq) + doubles(101325.0 - 12.0 * height, 1.0)

    def position(self, t_ns: int, seq: int, height: float) -> bytes:
        return head(t_ns, seq) + struct.pack("<bH", 0, 1) + doubles(46.6, 14.3, 500 + height, *[0.0] * 9) + b"\0"

    def image(self, t_ns: int, seq: int, _height: float) -> bytes:
        parts = struct.pack("<III", 250, 400, 5), b"mono8", struct.pack("<BII", 0, 400, IMAGE)
        return head(t_ns, seq) + b"".join(parts) + self._image


SENSORS = (
    ("/px4/imu", "sensor_msgs/msg/Imu", 200, Sensors.imu),
    ("/realsense/imu", "sensor_msgs/msg/Imu", 100, Sensors.imu),
    ("/lsm9ds1/imu", "sensor_msgs/msg/Imu", 50, Sensors.imu),
    ("/odometry", "nav_msgs/msg/Odometry", 30, Sensors.odometry),
    ("/px4/magnetometer", "sensor_msgs/msg/MagneticField", 20, Sensors.magnetic),
    ("/px4/barometer", "sensor_msgs/msg/FluidPressure", 20, Sensors.pressure),
    ("/lrf/range", "sensor_msgs/msg/Range", 20, Sensors.distance),
    ("/px4/gps", "sensor_msgs/msg/NavSatFix", 5, Sensors.position),
)
IMAGES = (
    ("/mission_camera/image_raw", "sensor_msgs/msg/Image", 10, Sensors.image),
    ("/realsense/image_raw", "sensor_msgs/msg/Image", 10, Sensors.image),
)


def flown(repetitions: int) -> list:
    """Return (time, event) of a survey in the simulated world, from the start of its recording to its end."""
    configuration = load_configuration(config_folder())
    (survey,) = (mission for mission in configuration.missions if mission.id == "4")
    mission = replace(survey, repetitions=repetitions, max_flight_time_ns=None)
    payloads = [line.payload for line in read("\n".join(run(configuration, (mission,), Scenario()).lines) + "\n").lines]
    begins, ends = (
        next(each.t_ns for each in payloads if type(each).__name__ == "Decision" and each.after == state)
        for state in ("START_RECORDING", "DATA_CLEANUP")
    )
    return [each for each in payloads if begins + S // 2 <= getattr(each, "t_ns", 0) <= ends]


def written(path: Path, *, repetitions: int = 2, images: bool = False, compression: str = "none") -> Path:
    """Write the flight; return the path."""
    events = [event for event in flown(repetitions) if type(event) in MESSAGES]
    shift = START_NS - events[0].t_ns
    rows = [(event.t_ns + shift, *MESSAGES[type(event)](event, event.t_ns + shift)) for event in events]
    heights = [(each.t_ns + shift, each.height_m or 0.0) for each in events if isinstance(each, AutopilotStatus)]
    streams = [*SENSORS, *(IMAGES if images else ())]
    length_ns = rows[-1][0] - START_NS
    ticks = [
        (START_NS + number * S // rate_hz + 1000 * place, place, number)
        for place, (_, _, rate_hz, _) in enumerate(streams)
        for number in range(length_ns * rate_hz // S)
    ]
    writer = Writer(path)
    if compression != "none":
        writer.set_compression(getattr(Writer.CompressionFormat, compression.upper()))
    with writer:
        _write(writer, rows, streams, sorted(ticks), heights)
    return path


def _write(writer: Writer, rows: list, streams: list, ticks: list, heights: list) -> None:
    kinds = {topic: message.__msgtype__ for _, topic, message in rows}
    kinds.update({topic: kind for topic, kind, _, _ in streams})
    of = {
        topic: writer.add_connection(topic, kind, typestore=STORE, callerid="/recorder", latching=0)
        for topic, kind in sorted(kinds.items())
    }
    sensors, place = Sensors(1), 0
    statuses = iter([*rows, (2**63, None, None)])
    due = next(statuses)
    for t_ns, number, seq in ticks:
        while due[0] <= t_ns:
            writer.write(of[due[1]], due[0], STORE.serialize_ros1(due[2], due[2].__msgtype__))
            due = next(statuses)
        while place + 1 < len(heights) and heights[place + 1][0] <= t_ns:
            place += 1
        topic, _, _, measure = streams[number]
        writer.write(of[topic], t_ns, measure(sensors, t_ns, seq, heights[place][1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("--repetitions", type=int, default=2, help="of the survey, 280 s each")
    parser.add_argument("--images", action="store_true")
    parser.add_argument("--compression", choices=("none", "lz4", "bz2"), default="none")
    options = parser.parse_args()
    written(options.output, repetitions=options.repetitions, images=options.images, compression=options.compression)


if __name__ == "__main__":
    main()
