"""Recordings that are no ROS 1 bags, written by libraries other than ours, or byte by byte."""

from __future__ import annotations

import math
import struct

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from replay_bags import START_NS, STORE, height_m
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS2 = get_typestore(Stores.ROS2_HUMBLE)


def as_ros2(message):
    """Return a message of ROS 1 as ROS 2 has it: its header has no number."""
    kind = getattr(message, "__msgtype__", "")
    if kind not in ROS2.types:
        return message
    names = [name for name in ROS2.types[kind].__dataclass_fields__ if not name.startswith("__")]
    values = {name: as_ros2(getattr(message, name)) for name in names if not name.isupper()}
    return ROS2.types[kind](**values)


def write_ros2(folder, rows):
    """Write the bag of ROS 2, a folder, by the rosbags library."""
    try:
        writer = Writer(folder, version=8)
    except TypeError:  # 0.9, of Python 3.8
        writer = Writer(folder)
    connections = {}
    with writer:
        for t_ns, topic, message in rows:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS2)
            writer.write(connections[topic], t_ns, bytes(ROS2.serialize_cdr(as_ros2(message), kind)))
    return folder


def write_mcap(path, rows, compression="zstd", *, ros1=False, finish=True, chunks=True):
    """Write an MCAP file by its own library, as ROS 2 or ROS 1 would."""
    store = STORE if ros1 else ROS2
    schema, encoding = ("ros1msg", "ros1") if ros1 else ("ros2msg", "cdr")
    schemas, channels = {}, {}
    with path.open("wb") as file:
        kind = CompressionType[compression.upper()]
        writer = McapWriter(file, chunk_size=50_000, compression=kind, use_chunking=chunks)
        writer.start("ros1" if ros1 else "ros2", "a test")
        for t_ns, topic, message in rows:
            kind = message.__msgtype__
            if kind not in schemas:
                text = store.generate_msgdef(kind, ros_version=1 if ros1 else 2)[0].encode()
                schemas[kind] = writer.register_schema(kind.replace("/msg/", "/") if ros1 else kind, schema, text)
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, encoding, schemas[kind])
            data = store.serialize_ros1(message, kind) if ros1 else ROS2.serialize_cdr(as_ros2(message), kind)
            writer.add_message(channels[topic], t_ns, bytes(data), t_ns)
        if finish:
            writer.finish()
    return path


# --- ULog -------------------------------------------------------------------------------------------------------------
# By PX4's specification, with the topics and fields of PX4 1.14 that matter; its clock begins 20 s before the log.


_BOOT_US = 20_000_000
_FORMATS = {
    "vehicle_status": "uint64_t timestamp;uint8_t arming_state;uint8_t nav_state;bool failsafe",
    "vehicle_land_detected": "uint64_t timestamp;bool landed;bool ground_contact",
    "position_setpoint": "uint64_t timestamp;bool valid;uint8_t type",
    "position_setpoint_triplet": "uint64_t timestamp;position_setpoint current",
    "vehicle_local_position": (
        "uint64_t timestamp;float x;float y;float z;float vx;float vy;float vz;"
        "bool xy_valid;bool z_valid;bool v_xy_valid;bool v_z_valid"
    ),
    "vehicle_attitude": "uint64_t timestamp;float[4] q",
    "battery_status": (
        "uint64_t timestamp;float voltage_v;float current_a;float remaining;uint8_t warning;bool connected"
    ),
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2",
    "vehicle_gps_position": (
        "uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;int32_t alt;float vel_m_s;"
        "uint8_t fix_type;uint8_t satellites_used"
    ),
    "sensor_gps": (
        "uint64_t timestamp;double latitude_deg;double longitude_deg;double altitude_msl_m;float vel_m_s;"
        "uint8_t fix_type;uint8_t satellites_used"
    ),
    "distance_sensor": (
        "uint64_t timestamp;float min_distance;float max_distance;float current_distance;uint8_t orientation"
    ),
    "vehicle_air_data": "uint64_t timestamp;float baro_pressure_pa",
    "vehicle_magnetometer": "uint64_t timestamp;float[3] magnetometer_ga",
}
_PACK = {"uint64_t": "Q", "uint8_t": "B", "bool": "?", "float": "f", "double": "d", "int32_t": "i"}


def ulog_rows(length_s=36.0, no_fix_s=(math.inf, math.inf)):
    """Return what PX4 logs of the flight of `replay_bags.height_m`: (seconds, topic, values).

    Armed at 7.6 s, AUTO.MISSION until AUTO.LAND at 26 s, disarmed at 31.5 s.
    """
    nav = lambda t: 4 if t < 7.6 else 3 if t < 26.0 else 18  # noqa: E731
    streams = (
        ("vehicle_status", 2.0, lambda t: (2 if 7.6 <= t < 31.5 else 1, nav(t), False)),
        ("vehicle_land_detected", 1.0, lambda t: (height_m(t) <= 0.01, height_m(t) <= 0.01)),
        ("vehicle_local_position", 10.0, lambda t: (0.0, 0.0, -height_m(t), 0.0, 0.0, 0.0, True, True, True, True)),
        ("vehicle_attitude", 20.0, lambda _: (1.0, 0.0, 0.0, 0.0)),
        ("battery_status", 1.0, lambda t: (16.0 - 0.01 * t, 10.0, 0.9 - 0.001 * t, 0, True)),
        ("sensor_combined", 50.0, lambda _: (0.0, 0.0, 0.0, 0.0, 0.0, -9.81)),
        ("vehicle_gps_position", 5.0, lambda t: _gps(t, 0 if no_fix_s[0] <= t < no_fix_s[1] else 3)),
        ("distance_sensor", 10.0, lambda t: (0.05, 40.0, 0.1 + height_m(t), 25)),
        ("vehicle_air_data", 10.0, lambda _: (95_600.0,)),
        ("vehicle_magnetometer", 10.0, lambda _: (0.2, 0.0, 0.4)),
    )  # fmt: skip
    rows = [
        (step / rate, topic, values(step / rate))
        for topic, rate, values in streams
        for step in range(int(length_s * rate))
    ]
    return sorted(rows, key=lambda row: (row[0], row[1]))


def _gps(t_s, fix):
    utc_us = START_NS // 1000 + round(t_s * 1e6)
    above_mm = 488_000 + int(1e3 * height_m(t_s))
    return utc_us, 473_977_420 + round(10 * t_s), 85_455_940, above_mm, 0.1, fix, 12


def gps_rows(length_s):
    """Return what PX4 since 1.14 logs of its GPS, in degrees."""
    times = [step / 5 for step in range(int(length_s * 5))]
    return [(t_s, "sensor_gps", (47.3977, 8.5456, 488.0 + height_m(t_s), 0.1, 3, 12)) for t_s in times]


def write_ulog(path, rows, texts=()):
    """Write a ULog; `texts`: (seconds, level 0..7, text)."""
    numbers = {topic: number for number, topic in enumerate(dict.fromkeys(topic for _, topic, _ in rows))}
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", _BOOT_US), _record(b"B", bytes(40))]
    formats = dict.fromkeys(name for topic in numbers for name in (*_inner(topic), topic))
    parts += [_record(b"F", f"{name}:{_FORMATS[name]};".encode()) for name in formats]
    parts += [_record(b"A", struct.pack("<BH", 0, number) + topic.encode()) for topic, number in numbers.items()]
    told = [(t_s, _record(b"L", struct.pack("<BQ", ord("0") + level, _us(t_s)) + text.encode()))
            for t_s, level, text in texts]  # fmt: skip
    for t_s, topic, values in rows:
        kinds = _kinds(topic)
        codes = "".join(
            _PACK[kind.split("[")[0]] * (int(kind[:-1].split("[")[1]) if "[" in kind else 1) for kind in kinds
        )
        data = struct.pack("<" + codes, _us(t_s), *values)
        told.append((t_s, _record(b"D", struct.pack("<H", numbers[topic]) + data)))
    path.write_bytes(b"".join(parts + [record for _, record in sorted(told, key=lambda each: each[0])]))
    return path


def _kinds(topic):
    """Return the types of the fields of a topic, those of a topic in it one after the other."""
    own = [each.split(" ")[0] for each in _FORMATS[topic].split(";")]
    return [kind for each in own for kind in (_kinds(each) if each in _FORMATS else [each])]


def _inner(topic):
    return [kind for kind in (each.split(" ")[0] for each in _FORMATS[topic].split(";")) if kind in _FORMATS]


def _us(t_s):
    return _BOOT_US + round(t_s * 1e6)


def _record(kind, data):
    return struct.pack("<H", len(data)) + kind + data


_ROS = {"uint64_t": "uint64", "uint8_t": "uint8", "float": "float32", "int32_t": "int32"}
_BOOT_NS = START_NS - _BOOT_US * 1000


def px4_rows(rows):
    """Return the same as messages of px4_msgs on the topics of uXRCE-DDS: (time in ns, topic, message)."""
    for topic in dict.fromkeys(topic for _, topic, _ in rows):
        kind = _px4_kind(topic)
        if kind not in ROS2.types:
            fields = [each.split(" ") for each in _FORMATS[topic].split(";")]
            lines = [f"{_ros_type(how)} {name}" for how, name in fields]
            ROS2.register(get_types_from_msg("\n".join(lines), kind))
    return [(_BOOT_NS + _us(t_s) * 1000, f"/fmu/out/{topic}", _px4_message(t_s, topic, values))
            for t_s, topic, values in rows]  # fmt: skip


def _px4_kind(topic):
    return "px4_msgs/msg/" + "".join(word.capitalize() for word in topic.split("_"))


def _ros_type(how):
    plain, *length = how.split("[")
    return "[".join([_ROS.get(plain, plain), *length])


def _px4_message(t_s, topic, values):
    left, fields = list(values), {"timestamp": _us(t_s)}
    for how, name in (each.split(" ") for each in _FORMATS[topic].split(";")[1:]):
        if "[" in how:
            count = int(how[:-1].split("[")[1])
            fields[name], left = np.array(left[:count], np.float32), left[count:]
        else:
            fields[name] = left.pop(0)
    return ROS2.types[_px4_kind(topic)](**fields)
