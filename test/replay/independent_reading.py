"""What is true of a recording, read without any code of ours: by pymavlink, the rosbags library and numpy alone.

The numbers of truth.yaml were written down from what this prints. It must never import amaze_autonomy, nor a helper
that does: what two readings agree on is worth something only while they share no code.

    python test/replay/independent_reading.py ../shared/data/px4_offboard.tlog

Times are seconds from the first message of the vehicle (of a bag: from the first message). A change has the time of the
first message that says so.
"""

from __future__ import annotations

import os
import sys
from collections import defaultdict
from pathlib import Path

os.environ["MAVLINK20"] = "1"

import numpy as np
import yaml
from pymavlink import mavutil
from rosbags.highlevel import AnyReader

G = 9.80665
GAP_S = {  # silences longer than this are told; no more than these topics matter to anybody
    "GPS_RAW_INT": 1.5,
    "HIGHRES_IMU": 1.5,
    "RAW_IMU": 5.0,
    "SYS_STATUS": 2.0,
    "/ardrone/imu": 0.2,
    "/ardrone/odometry/raw": 0.2,
    "/cf1/imu": 0.2,
    "/cf1/log_ranges": 0.2,
    "/imu/data": 0.2,
    "/imu/mag": 0.3,
    "/fix": 1.5,
    "/turtle1/pose": 0.3,
}
LANDED = {0: "unknown", 1: "on the ground", 2: "in the air", 3: "taking off", 4: "landing"}
WARNING = 4  # MAV_SEVERITY: it, and below it what is worse
OFF_GROUND_M, SURE_S = 0.3, 1.0
IMPACT_M_S2, FALL_M_S2, FALL_S, APART_S = 3 * G, 3.0, 0.15, 1.0


def read(path):
    """Return what is true of a recording: name of the fact to its value, or to rows that begin with a time."""
    facts = (of_log if path.suffix == ".tlog" else of_bag)(path)
    return {name: value for name, value in facts.items() if value not in (None, [], {})}


# --- telemetry logs ---------------------------------------------------------------------------------------------------


def of_log(path):
    """Read a MAVLink log by mavutil."""
    messages, bad = messages_of(path)
    vehicle = next(m.get_srcSystem() for _, m in messages if autopilot_beats(m))
    own = [(t, m) for t, m in messages if m.get_srcSystem() == vehicle or m.get_type().startswith("UNKNOWN")]
    begin_s, end_s = own[0][0], messages[-1][0]
    rows = defaultdict(list)  # by type
    for t, message in own:
        rows[message.get_type()].append((t - begin_s, message))
    beats = [(t, m) for t, m in rows["HEARTBEAT"] if autopilot_beats(m)]
    armed = changes((t, bool(m.base_mode & mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED)) for t, m in beats)
    heights = [(t, m.relative_alt / 1e3) for t, m in rows["GLOBAL_POSITION_INT"]]
    ranges = [(t, m.current_distance / 1e2) for t, m in rows["DISTANCE_SENSOR"] if m.current_distance < m.max_distance]
    return {
        "begins_us": round(begin_s * 1e6),
        "length_s": end_s - begin_s,
        "bad_frames": bad,
        "counts": {name: len(found) for name, found in sorted(rows.items()) if found},
        "gaps": gaps({name: [t for t, _ in found] for name, found in rows.items()}, end_s - begin_s),
        "armed": armed,
        "mode": changes((t, mavutil.mode_string_v10(m)) for t, m in beats),
        "landed": changes((t, LANDED[m.landed_state]) for t, m in rows["EXTENDED_SYS_STATE"]),
        "flights": [[*span, *flight(heights, ranges, *span)] for span in spans(armed, end_s - begin_s)],
        "gps_fix": changes((t, m.fix_type) for t, m in rows["GPS_RAW_INT"]),
        "voltage_v": extremes((t, m.voltage_battery / 1e3) for t, m in rows["SYS_STATUS"]),
        "remaining_percent": extremes(
            (t, m.battery_remaining) for t, m in rows["BATTERY_STATUS"] or rows["SYS_STATUS"]
        ),
        "height_m": extremes(heights),
        "range_m": extremes(ranges),
        "warnings": [[t, m.severity, m.text.strip()] for t, m in rows["STATUSTEXT"] if m.severity <= WARNING],
        **accelerations(log_accelerations(rows)),
        **tilts((t, np.cos(m.roll) * np.cos(m.pitch)) for t, m in rows["ATTITUDE"]),
    }


def messages_of(path):
    """Return all messages with their times, and the number of frames that cannot be read."""
    log, found, bad = mavutil.mavlink_connection(str(path)), [], 0
    while True:
        message = log.recv_msg()
        if message is None:
            return found, bad
        if message.get_type() == "BAD_DATA":
            bad += 1
        else:
            found.append((message._timestamp, message))


def autopilot_beats(message):
    """Return True for a heartbeat of something that flies: neither a ground station nor a gimbal."""
    return message.get_type() == "HEARTBEAT" and message.autopilot != mavutil.mavlink.MAV_AUTOPILOT_INVALID


def log_accelerations(rows):
    """Return |a| in m/s^2: HIGHRES_IMU is in SI, RAW_IMU of an ArduPilot in thousandths of g."""
    if rows["HIGHRES_IMU"]:
        return [(t, np.sqrt(m.xacc**2 + m.yacc**2 + m.zacc**2)) for t, m in rows["HIGHRES_IMU"]]
    return [(t, np.sqrt(m.xacc**2 + m.yacc**2 + m.zacc**2) * G / 1e3) for t, m in rows["RAW_IMU"]]


# --- bags -------------------------------------------------------------------------------------------------------------


def of_bag(path):
    """Read a bag by the rosbags library."""
    times, values = defaultdict(list), defaultdict(list)
    with AnyReader([path]) as reader:
        begin_ns, end_ns, count = reader.start_time, reader.end_time, reader.message_count
        if not count:
            return {"counts": {}, "messages": 0}
        for connection, t_ns, raw in reader.messages():
            topic, t = connection.topic, (t_ns - begin_ns) / 1e9
            times[topic].append(t)
            if connection.msgtype in READ:
                name, value = READ[connection.msgtype](topic, reader.deserialize(raw, connection.msgtype))
                values[name].append((t, value))
    return {
        "begins_us": begin_ns // 1000,
        "length_s": (end_ns - begin_ns) / 1e9,
        "counts": {name: len(found) for name, found in sorted(times.items())},
        "gaps": gaps(times, (end_ns - begin_ns) / 1e9),
        "nav_sat_status": changes(values["fix"]),
        "height_m": extremes(values["height"]),
        "range_m": extremes(values["range"]),
        "in_the_air": airborne(values["height"]),
        "in_the_air_by_range": airborne(values["range"], values["range"][0][1] if values["range"] else 0.0),
        **accelerations([(t, a) for t, (a, _) in values["imu"]]),
        **tilts((t, level) for t, (_, level) in values["imu"] if level is not None),
    }


def of_imu(_, message):
    """Return |a|, and how far up the vehicle's z axis points; None where the orientation is all zero."""
    a, q = message.linear_acceleration, message.orientation
    level = 1.0 - 2.0 * (q.x**2 + q.y**2) if abs(q.x**2 + q.y**2 + q.z**2 + q.w**2 - 1.0) < 0.1 else None
    return "imu", (np.sqrt(a.x**2 + a.y**2 + a.z**2), level)


READ = {
    "sensor_msgs/msg/Imu": of_imu,
    "sensor_msgs/msg/NavSatFix": lambda _, m: ("fix", int(m.status.status)),
    "nav_msgs/msg/Odometry": lambda _, m: ("height", float(m.pose.pose.position.z)),
    # front, back, up, left, right, zrange: the last one looks down, in mm
    "crazyflie_driver/msg/GenericLogData": lambda topic, m: (
        ("range", m.values[5] / 1e3) if topic.endswith("ranges") else ("other", None)
    ),
}


# --- facts ------------------------------------------------------------------------------------------------------------


def changes(rows):
    """Return the rows whose value is not that of the row before."""
    found = []
    for t, value in rows:
        if not found or found[-1][1] != value:
            found.append([t, value])
    return found


def gaps(times, end_s):
    """Return by topic where no message came for longer than its limit, up to the end: [from, length]."""
    found = {}
    for name in sorted(set(times) & set(GAP_S)):
        at = [*times[name], end_s]
        found[name] = [[t, after - t] for t, after in zip(at, at[1:]) if after - t > GAP_S[name]]
    return {name: rows for name, rows in found.items() if rows}


def extremes(rows):
    """Return the first, the last, the lowest and the highest value with the times of the latter."""
    rows = list(rows)
    if not rows:
        return {}
    low, high = min(rows, key=lambda row: row[1]), max(rows, key=lambda row: row[1])
    return {"first": rows[0][1], "last": rows[-1][1], "lowest": list(low), "highest": list(high)}


def spans(armed, end_s):
    """Return [armed, disarmed] out of changes; the last one may last to the end."""
    times = [t for t, _ in armed] + [end_s]
    return [[t, times[number + 1]] for number, (t, value) in enumerate(armed) if value]


def flight(heights, ranges, armed_s, disarmed_s):
    """Return lift-off, touchdown and the largest height of an arming.

    Heights are above the one at which it was armed. Lift-off and touchdown are those of the range where there is one:
    the estimated height drifts by half a metre while the vehicle stands.
    """
    ground_m = [height_m for t, height_m in heights if t <= armed_s][-1]
    above = [(t, height_m - ground_m) for t, height_m in heights if armed_s <= t <= disarmed_s]
    by = [(t, range_m) for t, range_m in ranges if armed_s <= t <= disarmed_s] or above
    found = airborne(by, apart_s=disarmed_s)
    return [*found[0], max(height_m for _, height_m in above)] if found else [None, None, None]


def airborne(rows, ground_m=0.0, apart_s=SURE_S):
    """Return [lift-off, touchdown]: the first and the last time above the limit; nearer than `apart_s` it is one."""
    up = [t for t, height_m in rows if height_m - ground_m > OFF_GROUND_M]
    parts = np.split(np.array(up), np.flatnonzero(np.diff(up) > apart_s) + 1) if up else []
    return [[part[0], part[-1]] for part in parts if part[-1] - part[0] > SURE_S]


def stretches(rows, bad, apart_s):
    """Return groups of the rows that are bad, those nearer than this in one group."""
    groups = []
    for row in rows:
        if bad(row[1]):
            if groups and row[0] - groups[-1][-1][0] <= apart_s:
                groups[-1].append(row)
            else:
                groups.append([row])
    return groups


def accelerations(rows):
    """Return impacts as [time, worst], free falls as [time, length, least]."""
    rows = [(float(t), float(a)) for t, a in rows]
    step_s = float(np.median(np.diff([t for t, _ in rows]))) if len(rows) > 1 else 0.0
    impacts = stretches(rows, lambda a: a > IMPACT_M_S2, APART_S)
    falls = stretches(rows, lambda a: a < FALL_M_S2, 1.5 * step_s)
    return {
        "impacts_m_s2": [[group[0][0], max(a for _, a in group)] for group in impacts],
        "free_falls": [
            [group[0][0], group[-1][0] - group[0][0], min(a for _, a in group)]
            for group in falls
            if group[-1][0] - group[0][0] >= FALL_S
        ],
    }


def tilts(levels):
    """Return [time, largest angle to the vertical in degrees]."""
    rows = [(t, float(np.degrees(np.arccos(np.clip(level, -1.0, 1.0))))) for t, level in levels]
    return {"largest_tilt_deg": list(max(rows, key=lambda row: row[1]))} if rows else {}


def plain(value):
    """Return a value as YAML writes it, numbers to the millisecond or millimetre."""
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    return round(float(value), 3) if isinstance(value, (float, np.floating)) else value


if __name__ == "__main__":
    for name in sys.argv[1:]:
        print(yaml.safe_dump({Path(name).name: plain(read(Path(name)))}, sort_keys=False, width=120), end="")
