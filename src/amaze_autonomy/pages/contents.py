"""What the flight page shows, as plain values: spans, plots, rates, the track, the timeline, figures.

Nothing is drawn of what nobody recorded: a plot of which every line is scripted is left out.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.bags.errors import MessageError
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    Mission,
    MissionStatus,
    RecordingStatus,
    VehicleLanded,
)
from amaze_autonomy.engine.rules import Limits, Rules
from amaze_autonomy.engine.state import State
from amaze_autonomy.missions import Fence, MissionPlan, outlines
from amaze_autonomy.monitoring.specs import EstimateSource

from ..journal.trace import Span, trace_of
from ..missions.csv_table import Frame
from ..replay.monitors.upsets import columns_of, mavlink_tilt, tilt_deg
from ..replay.recordings.sources import Recordings
from ..replay.timeline import Line, LineKind
from .readings import (
    Estimates,
    Series,
    bin_of,
    estimates_of,
    packed,
    rates_of,
    thinned,
    with_gaps,
)

_S = 1_000_000_000
_MOST_EVENTS = 5000
_MOST_TEXTS = 2000
_SMOOTH_S = 1.0
_ROS_WARNING = 4
_COMING_UP = 2

STATE_COLOURS: Mapping[str, str] = {
    State.MISSION_INPUT.value: "#dee2e6",
    State.PREFLIGHT.value: "#a5d8ff",
    State.OUTREACH.value: "#ffd8a8",
    State.READY.value: "#b2f2bb",
    State.START_RECORDING.value: "#99e9f2",
    State.LOAD_MISSION.value: "#91a7ff",
    State.TAKEOFF.value: "#74c0fc",
    State.MISSION.value: "#69db7c",
    State.HOLD.value: "#ffe066",
    State.LAND.value: "#ffa94d",
    State.PILOT.value: "#e599f7",
    State.DATA_CLEANUP.value: "#c5b8a5",
    State.MISSION_ENDED.value: "#ced4da",
}
"""Colours of the engine's states, the same on every page."""


class Sensors(NamedTuple):
    """Where the recorded sensors are.

    Args:
        watched: topic, component, expected rate, silence that is too long in seconds.
        range: topic, path of the distance, scale, limit in metres; None: there is none.
        imu: topic, paths of acceleration, turn rate and orientation, scale, and up in its own frame; None: likewise.
        estimate: topic and kind of message; None: likewise.
    """

    watched: Tuple[Tuple[str, str, Optional[float], Optional[float]], ...] = ()
    range: Optional[Tuple[str, str, float, float]] = None
    imu: Optional[Tuple[str, str, str, str, float, Tuple[float, float, float]]] = None
    estimate: Optional[Tuple[str, EstimateSource]] = None

    @property
    def topics(self) -> Tuple[str, ...]:
        """Return every topic, each once."""
        more = [each[0] for each in (self.range, self.imu, self.estimate) if each is not None]
        return tuple(dict.fromkeys([topic for topic, *_ in self.watched] + more))


@dataclass
class Story:
    """What a page is made of.

    Args:
        payloads: events and decisions in their order, on the clock of the recording.
        lines: of the timeline.
        start_ns: zero of the page's times.
        end_ns: of the recording.
        rules: that it was decided by.
        scripted: what of the vehicle and its nodes is not recorded.
        lead_scripted: what is before the first message is scripted.
        counterfactual_ns: see `Outcome`.
        mission: that the page is about; None: none was begun.
        plan: of the mission, with its waypoints; None: not known, or not what the vehicle flew.
        fences: of the mission.
        recordings: open; None: there is only a journal.
        sensors: in it.
    """

    payloads: List[object]
    lines: Sequence[Line]
    start_ns: int
    end_ns: int
    rules: Rules
    scripted: Tuple[str, ...] = ()
    lead_scripted: bool = False
    counterfactual_ns: Optional[int] = None
    mission: Optional[Mission] = None
    plan: Optional[MissionPlan] = None
    fences: Sequence[Fence] = ()
    recordings: Optional[Recordings] = None
    sensors: Sensors = field(default_factory=Sensors)
    facts: List[Tuple[str, str]] = field(default_factory=list)

    def seconds(self, t_ns: int) -> float:
        """Return a time of the page."""
        return round((t_ns - self.start_ns) / _S, 3)

    def events(self, kind: type) -> List[Any]:
        """Return all events of a kind."""
        return [each for each in self.payloads if isinstance(each, kind)]


def content_of(story: Story, title: str, result: str, words: str, below: Sequence[str]) -> Dict[str, Any]:
    """Return everything that the page shows.

    Args:
        story: of the flight.
        title: of the page.
        result: of the mission, in one word; empty: it has none.
        words: what came of it, in a sentence.
        below: lines of figures that stand at the end.
    """
    estimates, bands, events = _estimates(story), _bands(story), _events(story)
    plots = [
        plot
        for make in (_altitude, _speed, _battery, _range, _attitude, _imu, _link)
        for plot in make(story, estimates)
    ]
    begin_s = min([0.0, *(span[0] for band in bands for span in band["spans"])])
    states, mode = bands[:2]
    background = mode if mode["spans"] and not mode["scripted"] else states
    track = _track(story, estimates, background)
    parted_ns = story.counterfactual_ns
    return {
        "title": title,
        "result": result,
        "verdict": words,
        "facts": [*_facts(story, track), *story.facts],
        "begins": _date(story.start_ns),
        "begin_s": begin_s,
        "end_s": max(story.seconds(story.end_ns), begin_s + 0.001),
        "counterfactual_s": None if parted_ns is None else story.seconds(parted_ns),
        "scripted": list(story.scripted),
        "bands": bands,
        "background": background["name"],
        "colours": dict(STATE_COLOURS),
        "plots": plots,
        "rates": _rates(story),
        "track": track,
        "events": events[:_MOST_EVENTS],
        "events_left_out": max(0, len(events) - _MOST_EVENTS),
        "below": [line for line in below if line],
    }


def _date(t_ns: int) -> str:
    """Return a time of day, or nothing for a clock that counts from the computer's start."""
    if t_ns < 10**18:  # before 2001
        return ""
    return datetime.fromtimestamp(t_ns // _S, tz=timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")


def _spans(story: Story, changes: Iterable[Tuple[int, str]], end_ns: int) -> List[Tuple[float, float, str]]:
    """Return from when to when a text was so, out of what was said at each time; an empty text is left out."""
    found: List[Tuple[float, float, str]] = []
    begin_ns, now = 0, ""
    for t_ns, text in (*changes, (end_ns, "")):
        if text != now:
            if now and t_ns > begin_ns:
                found.append((story.seconds(begin_ns), story.seconds(t_ns), now))
            begin_ns, now = t_ns, text
    return found


def _band(name: str, spans: Sequence[Tuple[float, float, str]], kind: str, *, scripted: bool = False) -> Dict[str, Any]:
    return {"name": name, "spans": list(spans), "kind": kind, "scripted": scripted}


def _bands(story: Story) -> List[Dict[str, Any]]:
    """Return what was so for a time: states, modes, the vehicle, the planner, and each component that was not well."""
    trace = trace_of(story.payloads, story.start_ns, story.end_ns)
    statuses, planner = story.events(AutopilotStatus), story.events(MissionStatus)
    end_ns, gone = story.end_ns, story.scripted

    def plain(spans: Iterable[Span]) -> List[Tuple[float, float, str]]:
        return [(story.seconds(s.begin_ns), story.seconds(s.end_ns), s.value.rstrip("/")) for s in spans]

    bands = [
        _band("engine", plain(trace.states), "state"),
        _band(
            "flight mode", _spans(story, ((s.t_ns, s.mode) for s in statuses), end_ns), "mode", scripted="mode" in gone
        ),
        _band(
            "vehicle",
            _spans(story, ((s.t_ns, _vehicle(s)) for s in statuses), end_ns),
            "vehicle",
            scripted="armed" in gone and "landed" in gone,
        ),
        _band(
            "planner",
            _spans(story, ((s.t_ns, _planner(s)) for s in planner), end_ns),
            "planner",
            scripted="planner" in gone,
        ),
        _band(
            "recorder",
            _spans(story, ((s.t_ns, s.phase.name) for s in story.events(RecordingStatus)), end_ns),
            "recorder",
            scripted="recorder" in gone,
        ),
    ]
    failed = {name: spans for name, spans in trace.codes.items() if _failed(spans)}
    return bands + [_band(name, plain(spans), "code") for name, spans in failed.items()]


def _failed(spans: Sequence[Span]) -> bool:
    """Return whether a component got worse than it was: until each has come up for the first time they all are 2."""
    codes = [int(span.value) for span in spans]
    return any(later > before for before, later in zip(codes, codes[1:])) or max(codes, default=1) > _COMING_UP


def _vehicle(status: AutopilotStatus) -> str:
    if status.armed is None:
        return ""
    landed = {
        VehicleLanded.IN_AIR: "in the air",
        VehicleLanded.TAKING_OFF: "taking off",
        VehicleLanded.LANDING: "landing",
        VehicleLanded.ON_GROUND: "on the ground",
    }.get(status.landed, "")
    words = f"{'armed' if status.armed else 'disarmed'}{', ' if landed else ''}{landed}"
    more = [word for word, so in (("failsafe", status.failsafe), ("pilot in control", status.pilot_in_control)) if so]
    return ", ".join([words, *more])


def _planner(status: MissionStatus) -> str:
    waypoint = f" {status.waypoint}/{status.waypoints}" if status.waypoints and status.phase.name == "FLYING" else ""
    return f"{status.phase.name}{waypoint}"


# --- plots ------------------------------------------------------------------------------------------------------------


_Plots = List[Dict[str, Any]]


def _plot(
    title: str, unit: str, series: Iterable[Series], limits: Sequence[Tuple[str, float]] = (), **more: Any
) -> _Plots:
    """Return a plot of what is known; none where nothing of it is recorded."""
    known = [each for each in series if each.known]
    if all(each.scripted for each in known):
        return []
    lines = [{"text": text, "value": value} for text, value in limits if math.isfinite(value)]
    return [{"title": title, "unit": unit, "series": [each.plain() for each in known], "limits": lines, **more}]


def _told(story: Story, name: str, field_name: str, fact: str, scale: float = 1.0, **more: Any) -> List[Series]:
    """Return what the autopilot said, with what is before the recording apart where that is scripted."""
    statuses = story.events(AutopilotStatus)
    if not statuses:
        return []
    values = np.array([_nan(getattr(each, field_name)) for each in statuses], float) * scale
    t_s = np.array([(each.t_ns - story.start_ns) / _S for each in statuses])
    lead = t_s < 0 if story.lead_scripted and fact not in story.scripted else np.zeros(len(t_s), bool)
    parts = [(lead, True), (~lead, fact in story.scripted)]
    return [
        Series(name, *with_gaps(t_s[where], values[where]), scripted=scripted, **more)
        for where, scripted in parts
        if where.any()
    ]


def _nan(value: Optional[float]) -> float:
    return math.nan if value is None else float(value)


def _estimates(story: Story) -> Optional[Estimates]:
    if story.recordings is None or story.sensors.estimate is None:
        return None
    return estimates_of(story.recordings, *story.sensors.estimate, story.start_ns)


def _limit(story: Story, name: str) -> float:
    """Return a limit of the flight: the mission's own, else the configuration's."""
    own = getattr(story.mission, name, None) if story.mission is not None else None
    return float(own if own is not None else getattr(story.rules.limits, name))


def _altitude(story: Story, estimates: Optional[Estimates]) -> _Plots:
    series = _told(story, "altitude above takeoff", "height_m", "height")
    if estimates is not None:
        series.append(Series("z of the estimate", *with_gaps(estimates.t_s, estimates.z)))
    return _plot("Altitude", "m", series, [("limit", _limit(story, "max_height_m"))])


def _speed(story: Story, estimates: Optional[Estimates]) -> _Plots:
    series = _told(story, "over ground", "horizontal_speed_m_s", "position")
    series += _told(story, "climb", "vertical_speed_m_s", "height")
    if estimates is not None and estimates.speed is not None:
        series.append(Series("of the estimate", *with_gaps(estimates.t_s, estimates.speed)))
    return _plot("Speed", "m/s", series)


def _battery(story: Story, _: Optional[Estimates]) -> _Plots:
    series = _told(story, "level", "battery_fraction", "battery", 100.0)
    series += _told(story, "voltage (V)", "battery_voltage_v", "battery", right=True)
    limits: Limits = story.rules.limits
    return _plot("Battery", "%", series, [("lands below", limits.battery_critical_fraction * 100)], right="V")


def _range(story: Story, _: Optional[Estimates]) -> _Plots:
    if story.recordings is None or story.sensors.range is None:
        return []
    topic, path, scale, most_m = story.sensors.range
    t_s, (values, own) = columns_of(story.recordings, topic, (path, "max_range"), story.start_ns)
    if not len(t_s):
        return []
    metres = values * scale
    with np.errstate(invalid="ignore"):
        own_m = own * scale
        limit = np.where((own_m > 0) & (own_m < most_m), own_m, most_m)
        beyond = metres >= limit
    shown = np.where(beyond, limit, metres)
    series = [
        Series("distance", *with_gaps(t_s, np.where(beyond, np.nan, metres))),
        Series("nothing seen: at or above its limit", t_s, np.where(beyond, shown, np.nan)),
    ]
    return _plot("Range finder", "m", series, topic=topic)


def _attitude(story: Story, estimates: Optional[Estimates]) -> _Plots:
    series: List[Series] = []
    recordings, imu = story.recordings, story.sensors.imu
    if recordings is not None and imu is not None:
        t_s, parts = columns_of(recordings, imu[0], [f"{imu[3]}.{axis}" for axis in "xyzw"], story.start_ns)
        if len(t_s):
            series.append(Series("orientation of the IMU", *with_gaps(t_s, tilt_deg(*parts))))
        if not any(each.known for each in series):
            series.append(_gravity_tilt(story, recordings, imu))
    if estimates is not None:
        series.append(Series("estimate", *with_gaps(estimates.t_s, estimates.tilt)))
    told = None if recordings is None else mavlink_tilt(recordings)
    if told is not None:
        series.append(Series("attitude of the autopilot", *with_gaps(*told)))
    return _plot("Tilt", "deg", series)


def _gravity_tilt(story: Story, recordings: Recordings, imu: Any) -> Series:
    """Return the tilt as the accelerometer shows it, on the mean over a second; only of a vehicle that moves gently."""
    t_s, parts = columns_of(recordings, imu[0], [f"{imu[1]}.{axis}" for axis in "xyz"], story.start_ns)
    if len(t_s) < 2:  # noqa: PLR2004
        return Series("", np.zeros(0), np.zeros(0))
    width = max(1, round(_SMOOTH_S * len(t_s) / max(float(t_s[-1] - t_s[0]), 1e-9)))
    x, y, z = (np.convolve(np.nan_to_num(part), np.ones(width) / width, "same") for part in parts)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = (x * imu[5][0] + y * imu[5][1] + z * imu[5][2]) / np.sqrt(x * x + y * y + z * z)
    tilt = np.degrees(np.arccos(np.clip(along, -1.0, 1.0)))
    return Series("mean acceleration over 1 s", *with_gaps(t_s, tilt))


def _imu(story: Story, _: Optional[Estimates]) -> _Plots:
    if story.recordings is None or story.sensors.imu is None:
        return []
    topic, acceleration, turn_rate, _orientation, scale, _up = story.sensors.imu
    paths = [f"{name}.{axis}" for name in (acceleration, turn_rate) for axis in "xyz"]
    t_s, parts = columns_of(story.recordings, topic, paths, story.start_ns)
    if not len(t_s):
        return []
    length = [np.sqrt(sum(part * part for part in parts[first : first + 3])) for first in (0, 3)]
    series = [Series("acceleration", *with_gaps(t_s, length[0] * scale))]
    series.append(Series("turn rate (rad/s)", *with_gaps(t_s, length[1]), right=True))
    return _plot("IMU level", "m/s²", series, right="rad/s", topic=topic)


def _link(story: Story, _: Optional[Estimates]) -> _Plots:
    if "armed" in story.scripted:
        return []
    return _plot("Age of the autopilot's heartbeat", "s", _told(story, "age", "link_age_s", "armed"))


# --- rates, track, texts, facts ---------------------------------------------------------------------------------------


def _rates(story: Story) -> Dict[str, Any]:
    if story.recordings is None:
        return {"bin_s": 1.0, "topics": []}
    bin_s = bin_of(story.seconds(story.end_ns))
    found = rates_of(story.recordings, story.sensors.watched, bin_s)
    return {"bin_s": bin_s, "topics": [each.__dict__ for each in found]}


def _track(story: Story, estimates: Optional[Estimates], background: Mapping[str, Any]) -> Optional[Dict[str, Any]]:
    """Return where the vehicle was, in metres; None where nothing tells it."""
    flown = _flown_track(story, estimates)
    if flown is None:
        return None
    words, t_s, *axes, scripted = flown
    kept = np.unique(np.concatenate([np.searchsorted(t_s, thinned(t_s, axis, 3000)[0]) for axis in axes]))
    t_s, x, y, z = (np.asarray(each)[kept[kept < len(t_s)]] for each in (t_s, *axes))
    spans = background["spans"]
    begins = np.array([span[0] for span in spans])
    at: Any = np.searchsorted(begins, t_s, side="right") - 1 if len(spans) else np.full(len(t_s), -1)
    labels = list(dict.fromkeys(span[2] for span in spans))
    return {
        "about": words,
        "scripted": scripted,
        "t": packed(t_s),
        "x": packed(x),
        "y": packed(y),
        "z": packed(z),
        "labels": labels,
        "label": [labels.index(spans[place][2]) if place >= 0 else -1 for place in at.tolist()],
        "planned": _planned(story),
        **outlines(story.fences),
    }


def _flown_track(story: Story, estimates: Optional[Estimates]) -> Optional[Tuple[Any, ...]]:
    statuses = [each for each in story.events(AutopilotStatus) if each.position_x_m is not None]
    if statuses and "position" not in story.scripted:
        if story.lead_scripted:
            statuses = [each for each in statuses if each.t_ns >= story.start_ns]
        t_s = np.array([(each.t_ns - story.start_ns) / _S for each in statuses])
        parts = [np.array([_nan(getattr(each, name)) for each in statuses]) for name in _PLACE]
        if len(t_s):
            return ("metres east and north of the takeoff place, by the autopilot", t_s, *parts, False)
    if estimates is not None and np.isfinite(estimates.x).any() and np.ptp(estimates.x[np.isfinite(estimates.x)]) > 0:
        words = "metres in the frame of the estimate"
        return (words, estimates.t_s, estimates.x, estimates.y, estimates.z, False)
    return None


_PLACE = ("position_x_m", "position_y_m", "height_m")


def _planned(story: Story) -> List[List[List[float]]]:
    """Return the waypoints of each file in metres; none of a file that counts from a heading that nobody knows."""
    if story.plan is None or story.plan.frame is not Frame.EAST_NORTH:
        return []
    return [[[w.x_m, w.y_m, w.z_m] for w in each.waypoints] for each in story.plan.trajectories]


def _events(story: Story) -> List[Dict[str, Any]]:
    """Return the timeline, with the texts of the autopilot and warnings of nodes that the recording holds."""
    lines: List[Dict[str, Any]] = [
        {
            "t": story.seconds(line.t_ns),
            "source": line.source.words,
            "kind": line.kind.value,
            "text": line.text,
            "level": line.level,
            "times": line.times,
            "until": story.seconds(line.until_ns) if line.times > 1 else None,
            "scripted": line.scripted,
            "counterfactual": line.counterfactual,
        }
        for line in story.lines
    ]
    known: Dict[str, List[Tuple[float, float]]] = {}
    for each in lines:
        for part in _parts(each["text"]):
            known.setdefault(part, []).append((each["t"], each["until"] or each["t"]))
    more = [each for each in _texts(story) if not _within(each["t"], known.get(_parts(each["text"])[-1], ()))]
    return sorted([*lines, *more], key=lambda each: each["t"])


def _within(t_s: float, spans: Iterable[Tuple[float, float]]) -> bool:
    return any(begin_s <= t_s <= end_s for begin_s, end_s in spans)


def _parts(text: str) -> List[str]:
    """Return a text and what follows each colon in it: the timeline may have it already, under another name."""
    pieces = text.split(": ")
    return [": ".join(pieces[place:]).strip('"') for place in range(len(pieces))]


def _texts(story: Story) -> List[Dict[str, Any]]:
    found: List[Dict[str, Any]] = []
    for bag in story.recordings.bags if story.recordings is not None else ():
        for topic in bag.topics:
            read = _TEXT_KINDS.get(topic.kind)
            for entry in bag.entries(topic.name) if read is not None else ():
                with suppress(MessageError):
                    said = read(bag.message(entry))  # type: ignore[misc]  # there are entries only with it
                    if said is not None and story.start_ns <= entry.t_ns <= story.end_ns:
                        found.append(_text(story.seconds(entry.t_ns), *said))
    return found[:_MOST_TEXTS]


def _text(t_s: float, text: str, level: int) -> Dict[str, Any]:
    about = {"t": t_s, "source": "bag", "kind": "text", "text": text, "level": level, "times": 1, "until": None}
    return {**about, "scripted": False, "counterfactual": False}


def _mavlink_text(message: Any) -> Optional[Tuple[str, int]]:
    severity = int(message.severity)
    text = message.text
    words = text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
    return f"autopilot: {words.rstrip(chr(0)).strip()}", 2 if severity <= 3 else 1 if severity == 4 else 0  # noqa: PLR2004


def _ros_text(message: Any) -> Optional[Tuple[str, int]]:
    level = int(message.level)
    return None if level < _ROS_WARNING else (f"{message.name}: {message.msg}", 1 if level == _ROS_WARNING else 2)


_TEXT_KINDS: Mapping[str, Callable[[Any], Optional[Tuple[str, int]]]] = {
    "mavlink/STATUSTEXT": _mavlink_text,
    "mavros_msgs/StatusText": _mavlink_text,
    "rosgraph_msgs/Log": _ros_text,
}


def _facts(story: Story, track: Optional[Mapping[str, Any]]) -> List[Tuple[str, str]]:
    """Return the figures of the flight that stand on top."""
    statuses = story.events(AutopilotStatus)
    facts = [("Length", _clock(story.seconds(story.end_ns)))]
    if "armed" not in story.scripted:
        armed = _spans(story, ((s.t_ns, "armed" if s.armed else "") for s in statuses), story.end_ns)
        facts.append(("Armed", _clock(sum(end - begin for begin, end, _ in armed)) if armed else "never"))
    facts += _most(story, statuses, "height_m", "height", "Highest", "m")
    facts += _most(story, statuses, "horizontal_speed_m_s", "position", "Fastest", "m/s")
    levels = [s.battery_fraction for s in statuses if s.battery_fraction is not None]
    if levels and "battery" not in story.scripted:
        facts.append(("Battery", f"{levels[0] * 100:.0f} %, lowest {min(levels) * 100:.0f} %"))
    decisions = sum(line.kind is LineKind.DECISION for line in story.lines)
    facts.append(("Decisions", str(decisions)))
    if story.mission is not None and "planner" not in story.scripted:
        facts.append(("Mission", f"{story.mission.id} {story.mission.description}".strip()))
    if track is None and "position" not in story.scripted:
        facts.append(("Track", "no position recorded"))
    return facts


def _most(
    story: Story, statuses: Sequence[AutopilotStatus], name: str, fact: str, words: str, unit: str
) -> List[Tuple[str, str]]:
    values = [getattr(each, name) for each in statuses if getattr(each, name) is not None]
    return [] if fact in story.scripted or not values else [(words, f"{max(values):.1f} {unit}")]


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d} min" if seconds >= 60 else f"{seconds:.1f} s"  # noqa: PLR2004
