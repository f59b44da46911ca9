"""Bags that the tests write themselves: no recording is needed to test any of the replay."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROOT = Path(__file__).resolve().parents[2]
START_NS = 1_600_000_000_000_000_000
S = 1_000_000_000


def typestore():
    """Return the types of Noetic and our own, from msg/."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types = {}
    for path in sorted((ROOT / "msg").glob("*.msg")):
        types.update(get_types_from_msg(path.read_text(), f"amaze_autonomy/msg/{path.stem}"))
    store.register(types)
    return store


STORE = typestore()


def make(message_type, **fields):
    """Return a message, e.g. make("std_msgs/msg/Bool", data=True)."""
    return STORE.types[message_type](**fields)


def header(t_ns, seq=0):
    stamp = make("builtin_interfaces/msg/Time", sec=t_ns // S, nanosec=t_ns % S)
    return make("std_msgs/msg/Header", seq=seq, stamp=stamp, frame_id="")


def xyz(x, y, z):
    return make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def imu(t_ns, acceleration=(0.0, 0.0, 9.81), orientation=(0.0, 0.0, 0.0, 1.0)):
    x, y, z, w = orientation
    return make(
        "sensor_msgs/msg/Imu",
        header=header(t_ns),
        orientation=make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
        orientation_covariance=np.zeros(9),
        angular_velocity=xyz(0, 0, 0),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=xyz(*acceleration),
        linear_acceleration_covariance=np.zeros(9),
    )


def distance(t_ns, metres):
    return make(
        "sensor_msgs/msg/Range",
        header=header(t_ns),
        radiation_type=1,
        field_of_view=0.01,
        min_range=0.01,
        max_range=40.0,
        range=float(metres),
    )


def number(value):
    return make("std_msgs/msg/UInt8", data=value)


def battery(t_ns, fraction):
    nan = math.nan
    return make(
        "sensor_msgs/msg/BatteryState",
        header=header(t_ns),
        voltage=nan,
        temperature=nan,
        current=nan,
        charge=nan,
        capacity=nan,
        design_capacity=nan,
        percentage=float(fraction),
        power_supply_status=0,
        power_supply_health=0,
        power_supply_technology=0,
        present=True,
        cell_voltage=np.zeros(0, dtype=np.float32),
        cell_temperature=np.zeros(0, dtype=np.float32),
        location="",
        serial_number="",
    )


def magnetic(t_ns):
    return make(
        "sensor_msgs/msg/MagneticField",
        header=header(t_ns),
        magnetic_field=xyz(0, 0, 0),
        magnetic_field_covariance=np.zeros(9),
    )


def height_m(t_s):
    """Return the height of the flight: on the ground, up at 8 s to 3 m, down from 26 s to 30 s."""
    return min(3.0, max(0.0, 1.5 * (t_s - 8.0)), max(0.0, 0.75 * (30.0 - t_s)))


def flight_rows(length_s=36.0, silent=None, tilt_deg=0.0, fraction=0.9, orientation=(0.0, 0.0, 0.0, 1.0)):
    """Return the messages of a flight: (time, topic, message), in order of time.

    Args:
        length_s: of the recording.
        silent: by topic, (from, to) in seconds without a message.
        tilt_deg: of the vehicle on its pad.
        fraction: of the battery.
        orientation: that the IMU says.
    """
    silent = silent or {}
    g = (9.81 * math.sin(math.radians(tilt_deg)), 0.0, 9.81 * math.cos(math.radians(tilt_deg)))
    streams = (
        ("/imu", 50, lambda t_ns, _: imu(t_ns, g, orientation)),
        ("/range", 20, lambda t_ns, t_s: distance(t_ns, 0.05 + height_m(t_s))),
        ("/mag", 10, lambda t_ns, _: magnetic(t_ns)),
        ("/battery", 2, lambda t_ns, _: battery(t_ns, fraction)),
        ("/armed", 10, lambda _, t_s: make("std_msgs/msg/Bool", data=7.6 <= t_s < 31.5)),
        ("/landed", 10, lambda _, t_s: number(1 if height_m(t_s) <= 0.01 else 2)),
    )
    rows = []
    for topic, rate_hz, message in streams:
        begin_s, end_s = silent.get(topic, (math.inf, math.inf))
        for index in range(int(length_s * rate_hz)):
            t_s = index / rate_hz
            if not begin_s <= t_s < end_s:
                t_ns = START_NS + round(t_s * S)
                rows.append((t_ns, topic, message(t_ns, t_s)))
    return sorted(rows, key=lambda row: row[0])


def write_bag(path, rows, compression="none", callers=None, order=None, chunk_bytes=100_000):
    """Write messages as they come; return the path.

    Args:
        path: of the bag.
        rows: (time, topic, message) or (time, topic, message, caller).
        compression: none, lz4 or bz2.
        callers: names of publishers by topic.
        order: topics whose connections are to be made first, in this order.
        chunk_bytes: about the size of a chunk.
    """
    writer = Writer(path)
    writer.chunk_threshold = chunk_bytes
    if compression != "none":
        writer.set_compression(getattr(Writer.CompressionFormat, compression.upper()))
    kinds = {row[1]: row[2].__msgtype__ for row in rows}
    connections = {}
    with writer:
        for topic in [*(order or ()), *dict.fromkeys(row[1] for row in rows)]:
            for caller in dict.fromkeys(_caller(row, callers) for row in rows if row[1] == topic):
                if (topic, caller) not in connections:
                    connections[topic, caller] = writer.add_connection(
                        topic, kinds[topic], typestore=STORE, callerid=caller, latching=0
                    )
        for row in rows:
            raw = STORE.serialize_ros1(row[2], row[2].__msgtype__)
            writer.write(connections[row[1], _caller(row, callers)], row[0], raw)
    return path


def _caller(row, callers):
    return row[3] if len(row) > 3 else (callers or {}).get(row[1], "/recorder")


def write_empty_bag(path):
    """Write a bag without messages; return its path."""
    with Writer(path):
        return path


def break_chunk(path, place, start, size):
    """Overwrite bytes of a chunk with zeros; return where the chunk lies, as the index has it.

    Args:
        path: of the bag.
        place: number of the chunk, in their order in the file.
        start: of the bytes, from the chunk's data on.
        size: how many.
    """
    with Reader(path) as reader:
        position = sorted(reader.chunks)[place]
        begin = reader.chunks[position].datapos + start
    data = bytearray(path.read_bytes())
    data[begin : begin + size] = bytes(size)
    path.write_bytes(data)
    return position


def rewrite(source, path, compression):
    """Write the messages of a bag into another one, as a tool that compresses does; return its path."""
    writer = Writer(path)
    if compression != "none":
        writer.set_compression(getattr(Writer.CompressionFormat, compression.upper()))
    with Reader(source) as reader, writer:
        connections = {}
        for each in reversed(reader.connections):
            definition = getattr(each.msgdef, "data", each.msgdef)
            connections[each.id] = writer.add_connection(
                each.topic, each.msgtype, msgdef=definition, md5sum=each.digest, callerid=each.ext.callerid, latching=0
            )
        for connection, t_ns, raw in reader.messages():
            writer.write(connections[connection.id], t_ns, raw)
    return path
