"""What happens to a vehicle that no status tells: free fall, an impact, a tilt beyond a flight's; ranges at a limit.

Looked for in the recorded accelerometer, attitude and range after the replay, over the times in which it was in the air
by the recorded landed state, and a moment longer: the impact ends the flight. Each is one line with its worst value.
"""

from __future__ import annotations

import math
from typing import Any, Iterable, List, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.bags import Entry
from amaze_autonomy.bags.errors import MessageError
from amaze_autonomy.engine.events import AutopilotStatus, VehicleLanded

from ..errors import FieldError
from ..plan import Plan
from ..recordings.fields import getter, number
from ..timeline import Line, LineKind, Source

_S = 1_000_000_000
_AFTER_S = 2.0  # behind the air
_FREE_FALL_M_S2, _FALLS_S = 3.0, 0.15  # a descent has more, a bump is shorter
_IMPACT_M_S2 = 25.0  # no multicopter has 2.5 g by its propellers in a mission
_TILT_DEG, _TILTS_S = 45.0, 0.2
_APART_S = 1.0  # nearer than this it is one
_IN_AIR = (VehicleLanded.IN_AIR, VehicleLanded.TAKING_OFF, VehicleLanded.LANDING)
_ORIENTATION = "orientation"
_Spans = Sequence[Tuple[float, float]]


def upsets_of(plan: Plan, recordings: Any, statuses: Iterable[AutopilotStatus], *, flown: bool) -> List[Line]:
    """Return the lines of a replay.

    Args:
        plan: of the replay.
        recordings: that were replayed.
        statuses: of the vehicle.
        flown: the recording tells when it was in the air.
    """
    if recordings.faulted:  # what a scenario has put into it did not happen to the vehicle
        return []
    start_ns, readings = recordings.start_ns, plan.topic_map.readings
    lines = _range_lines(plan, recordings)
    spans = airborne(statuses, start_ns) if flown else ()
    if not spans:
        return lines
    acceleration: Optional[Tuple[Any, Any]] = None
    tilt = mavlink_tilt(recordings)
    if "imu" in readings:
        imu = readings["imu"]
        vectors = [imu.fields[name] for name in ("acceleration", "turn_rate") if name in imu.fields]
        paths = [f"{path}.{axis}" for path in vectors for axis in "xyz"]  # as they were read for the checks
        t_s, parts = columns_of(recordings, imu.topic, paths, start_ns)
        acceleration = t_s, np.sqrt(sum(part * part for part in parts[:3])) * imu.scale
        if tilt is None and _ORIENTATION in imu.fields:
            paths = [f"{imu.fields[_ORIENTATION]}.{axis}" for axis in "xyzw"]
            t_s, parts = columns_of(recordings, imu.topic, paths, start_ns)
            tilt = t_s, tilt_deg(*parts)
    return lines + upset_lines(spans, acceleration, tilt, start_ns)


def airborne(statuses: Iterable[AutopilotStatus], start_ns: int) -> List[Tuple[float, float]]:
    """Return from when to when the vehicle was in the air, in seconds; the last span may not have ended."""
    found: List[Tuple[float, float]] = []
    begin_s: Optional[float] = None
    last_s = 0.0
    for status in statuses:
        last_s = (status.t_ns - start_ns) / _S
        if status.landed in _IN_AIR:
            begin_s = last_s if begin_s is None else begin_s
        elif begin_s is not None and status.landed is VehicleLanded.ON_GROUND:
            found.append((max(begin_s, 0.0), last_s))
            begin_s = None
    return found if begin_s is None else [*found, (max(begin_s, 0.0), last_s)]


def upset_lines(
    spans: _Spans, acceleration: Optional[Tuple[Any, Any]], tilt: Optional[Tuple[Any, Any]], start_ns: int
) -> List[Line]:
    """Return a line for each upset, in order.

    Args:
        spans: in which the vehicle was in the air.
        acceleration: times in seconds, and its magnitude in m/s^2; None: not recorded.
        tilt: times, and the angle to the vertical in degrees; None: not recorded.
        start_ns: zero of the times.
    """
    found: List[Tuple[float, str]] = []
    if acceleration is not None and len(acceleration[0]):
        t_s, value = acceleration
        flying = _within(t_s, spans)
        for begin, end in _stretches(t_s, flying & (value < _FREE_FALL_M_S2), _FALLS_S):
            least = float(np.nanmin(value[begin:end]))
            words = f"free fall for {t_s[end - 1] - t_s[begin]:.2f} s: acceleration down to {least:.1f} m/s^2"
            found.append((t_s[begin], f"{words}, below {_FREE_FALL_M_S2:g} m/s^2"))
        for begin, end in _stretches(t_s, flying & (value > _IMPACT_M_S2), 0.0):
            most = float(np.nanmax(value[begin:end]))
            found.append((t_s[begin], f"impact: acceleration up to {most:.1f} m/s^2, above {_IMPACT_M_S2:g} m/s^2"))
    if tilt is not None and len(tilt[0]):
        t_s, value = tilt
        for begin, end in _stretches(t_s, _within(t_s, spans) & (value > _TILT_DEG), _TILTS_S):
            words = f"tilted in flight: up to {float(np.nanmax(value[begin:end])):.0f} deg, limit {_TILT_DEG:g} deg"
            found.append((t_s[begin], f"{words}, for {t_s[end - 1] - t_s[begin]:.2f} s"))
    return [
        Line(start_ns + round(float(at_s) * _S), Source.BAG, LineKind.MONITOR, words, 2)
        for at_s, words in sorted(found)
    ]


def _within(t_s: Any, spans: _Spans) -> Any:
    """Return which times are in a span, or soon behind it."""
    inside: Any = np.zeros(len(t_s), bool)
    for begin_s, end_s in spans:
        inside |= (t_s >= begin_s) & (t_s <= end_s + _AFTER_S)
    return inside


def _stretches(t_s: Any, bad: Any, least_s: float) -> List[Tuple[int, int]]:
    """Return places from and to of what is bad for at least some time; what is hardly apart is one."""
    places = np.flatnonzero(bad)
    if not len(places):
        return []
    parts = np.split(places, np.flatnonzero((np.diff(t_s[places]) > _APART_S) | _breaks(places, least_s)) + 1)
    return [(int(part[0]), int(part[-1]) + 1) for part in parts if t_s[part[-1]] - t_s[part[0]] >= least_s]


def _breaks(places: Any, least_s: float) -> Any:
    """Return where a good sample lies between: what must last is broken by one, what is a peak is not."""
    return (np.diff(places) > 1) & (least_s > 0)


def _range_lines(plan: Plan, recordings: Any) -> List[Line]:
    """Return a line on readings at or above what their own message calls its greatest."""
    reading = plan.topic_map.readings.get("range")
    if plan.landing is None or reading is None:
        return []
    start_ns = recordings.start_ns
    t_s, (value, _, most) = columns_of(
        recordings, reading.topic, (reading.fields["distance"], "min_range", "max_range"), start_ns
    )
    with np.errstate(invalid="ignore"):
        most_m = most * reading.scale
        beyond = np.flatnonzero((value * reading.scale >= most_m) & (most_m > 0))
    if not len(beyond):
        return []
    own_m = float(most_m[beyond[0]])
    wins = (
        f"the map's {plan.landing.max_range_m:g} m count" if "max_range_m" in plan.topic_map.landing else "nothing seen"
    )
    words = (
        f"range: {len(beyond)} of {len(value)} readings are at or above the max_range of their own message, "
        f"{own_m:g} m, until {t_s[beyond[-1]]:+.3f} s: {wins}"
    )
    return [Line(start_ns + round(float(t_s[beyond[0]]) * _S), Source.BAG, LineKind.NOTE, words, 1)]


# --- columns ----------------------------------------------------------------------------------------------------------


def columns_of(recordings: Any, topic: str, paths: Sequence[str], start_ns: int) -> Tuple[Any, List[Any]]:
    """Return the times of a topic's messages in seconds, and a column for each path; NaN where there is no number."""
    if topic not in recordings.topics or topic in recordings.missing:
        return np.zeros(0), [np.zeros(0) for _ in paths]
    rank = recordings.topics.index(topic)
    read = recordings.paths_read(rank)
    if not set(paths) <= set(read):  # a bag is not read again for what is known of it
        read = tuple(paths)
        recordings.read({rank: read})
    track = recordings.track(rank, read) if all(hasattr(bag, "numbers") for bag in recordings.bags) else None
    found: List[Any]
    if track is not None and len(track.columns) == len(read):
        t_ns, found = track.times, [np.asarray(track.columns[read.index(path)], float) for path in paths]
    else:
        t_ns, found = recordings.times(rank), _one_by_one(recordings, rank, paths)
    return (np.asarray(t_ns, np.int64) - start_ns) / _S, found


def _one_by_one(recordings: Any, rank: int, paths: Sequence[str]) -> List[Any]:
    """Return columns out of whole messages: of logs, and of bags whose messages are irregular or damaged."""
    gets = [getter(path) for path in paths]
    rows: List[List[float]] = []
    for sample in recordings.ordered([rank]):
        row = [math.nan] * len(paths)
        try:
            place = Entry(sample.t_ns, sample.publisher, sample.chunk, sample.offset, sample.connection)
            message = recordings.bags[sample.bag].message(place)
        except MessageError:
            message = None
        for column, get in enumerate(gets if message is not None else ()):
            try:
                value = number(get(message))
            except FieldError:
                value = None
            row[column] = math.nan if value is None else value
        rows.append(row)
    return list(np.array(rows, float).reshape(-1, len(paths)).T)


def tilt_deg(x: Any, y: Any, z: Any, w: Any) -> Any:
    """Return the angle between the vehicle's z axis and up of quaternions in degrees; NaN for what is none."""
    norm = x * x + y * y + z * z + w * w
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = 1.0 - 2.0 * (x * x + y * y) / norm
        return np.where(np.abs(norm - 1.0) < 0.1, np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))), np.nan)  # noqa: PLR2004


def mavlink_tilt(recordings: Any) -> Optional[Tuple[Any, Any]]:
    """Return times and tilt that an autopilot tells over MAVLink; None: it does not."""
    for bag in recordings.bags:
        entries = [] if hasattr(bag, "numbers") else bag.entries("/mavlink/ATTITUDE")
        said = [(entry.t_ns, bag.message(entry)) for entry in entries]
        if said:
            t_s = np.array([(t_ns - recordings.start_ns) / _S for t_ns, _ in said])
            level = np.array([math.cos(each.roll) * math.cos(each.pitch) for _, each in said])
            return t_s, np.degrees(np.arccos(np.clip(level, -1.0, 1.0)))
    return None
