"""The page of one flight: what happened, what was decided and why, out of a replay, a journal, or a bag with one.

Everything that is shown is in `FlightPage.content`, as plain values: whoever wants to know what it says looks there.
Times are seconds from the first message of the recording, or of the journal where there is no recording. What was not
recorded is marked: `scripted`, where the scripted world of a replay said it; `counterfactual`, where the recorded
vehicle had not got a command of the replay.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.bags import Recording
from amaze_autonomy.bags.format import MEMORY
from amaze_autonomy.config import ConfigError
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.engine.commands import Decision, Level, Notify
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import (
    EngineStarted,
    Event,
    LandedStatus,
    Mission,
    WatchdogInfo,
)
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, State, evolve
from amaze_autonomy.missions import Fence, MissionPlan, Polygon
from amaze_autonomy.monitoring.specs import EstimateSource
from amaze_autonomy.replay.compare import Comparison

from ..journal.journal import Journal, decode, rules_of
from ..journal.report import end_on_the_way
from ..monitoring.gravity import rotation_from_rpy
from ..replay.plan import Plan
from ..replay.recordings.journals import JOURNAL_KIND, read_log
from ..replay.recordings.sources import Recordings
from ..replay.report import comparison_lines, footer_lines, verdict
from ..replay.session import Outcome
from ..replay.timeline import Line, LineKind, Notes, Source, decision_text, joined, marked
from .contents import Sensors, Story, content_of
from .document import write_document

_S = 1_000_000_000
_BAG_MAGIC = b"#ROSBAG"


@dataclass
class FlightPage:
    """What the page shows: plain values, as the page's scripts read them."""

    title: str
    content: Dict[str, Any] = field(default_factory=dict)

    def write(self, path: Path) -> None:
        """Write the page as one file.

        Raises:
            OSError: it cannot be written.
            PageError: the plot library is not installed.
        """
        write_document(path, self.title, ("flight",), self.content)


# --- from a replay ----------------------------------------------------------------------------------------------------


def replay_page(plan: Plan, recordings: Recordings, outcome: Outcome, mission: Optional[MissionPlan]) -> FlightPage:
    """Return the page of a replay.

    Args:
        plan: of the replay.
        recordings: that were replayed, still open.
        outcome: of the replay.
        mission: with its waypoints; shown where the recording tells that it was flown.
    """
    names = ", ".join(bag.path.name for bag in recordings.bags)
    own = "planner" not in outcome.scripted
    story = Story(
        payloads=[decode(line, number).payload for number, line in enumerate(outcome.journal, 1)],
        lines=outcome.timeline,
        start_ns=outcome.start_ns,
        end_ns=outcome.end_ns,
        rules=plan.rules,
        scripted=outcome.scripted,
        lead_scripted=True,
        counterfactual_ns=outcome.counterfactual_ns,
        mission=outcome.mission,
        plan=mission if own else None,
        fences=_fences_of(mission, plan.configuration, outcome.mission.id) if own else (),
        recordings=recordings,
        sensors=_sensors_of_plan(plan),
        facts=[("Map", plan.topic_map.name)],
    )
    title, result = f"Replay of {names}", outcome.state.session.result.value
    return FlightPage(
        title, content_of(story, title, result, verdict(outcome), footer_lines(plan, recordings, outcome))
    )


def _sensors_of_plan(plan: Plan) -> Sensors:
    readings = plan.topic_map.readings
    found = Sensors(
        watched=tuple(
            (topic.topic, spec.name, topic.rate_hz, topic.age_limit_ns / _S)
            for spec in plan.components
            for topic in spec.topics
        )
    )
    if plan.landing is not None and "range" in readings:
        reading = readings["range"]
        found = found._replace(
            range=(reading.topic, reading.fields["distance"], reading.scale, plan.landing.max_range_m)
        )
    if plan.state_estimation is not None and "imu" in readings:
        reading, turned = readings["imu"], rotation_from_rpy(plan.state_estimation.imu_mounting_rpy_rad)
        paths = [reading.fields.get(name, default) for name, default in _IMU_FIELDS.items()]
        found = found._replace(imu=(reading.topic, paths[0], paths[1], paths[2], reading.scale, turned[2]))
    if plan.state_estimation is not None and "estimate" in readings:
        found = found._replace(estimate=(readings["estimate"].topic, plan.state_estimation.source))
    return found


_IMU_FIELDS = {
    "acceleration": "linear_acceleration",
    "turn_rate": "angular_velocity",
    "orientation": "orientation",
}


# --- from a journal ---------------------------------------------------------------------------------------------------


def journal_page(
    path: Path, journal: Journal, comparison: Comparison, rules: Optional[Rules] = None, memory: int = MEMORY
) -> FlightPage:
    """Return the page of a journal, with the sensors of the bag that it lies in, or that lies beside it.

    Args:
        path: of the journal, or of the bag that it was read from.
        journal: whole.
        comparison: of its decisions with those that are made now.
        rules: that it was decided by again; None: its own.
        memory: bytes that a chunk of the bag may take, decompressed.
    """
    header = journal.lines[0].payload
    configuration = header.get("configuration", {}) if isinstance(header, dict) else {}
    decided = rules_of(journal.lines[0], rules)
    sensors = _sensors_of_configuration(configuration)
    recordings, late_ns = _recording_of(path, sensors, memory)
    try:
        payloads = [_later(line.payload, late_ns) for line in journal.lines[1:]]
        times = [each.t_ns for each in payloads if isinstance(each, (Event, Decision))] or [0]
        start_ns = recordings.start_ns if recordings is not None else times[0]
        first = comparison.first
        parted_ns = None if first is None else first.event.t_ns + late_ns - 1
        lines, flown = _decided(payloads, decided, start_ns)
        part = _part_of(flown, None if recordings is None else start_ns, times[-1])
        story = Story(
            payloads=[each for each in payloads if part.holds(getattr(each, "t_ns", 0))],
            lines=marked(joined(line for line in lines if part.holds(line.t_ns)), parted_ns),
            start_ns=start_ns,
            end_ns=max(part.end_ns, recordings.end_ns if recordings is not None else 0),
            rules=decided,
            counterfactual_ns=parted_ns,
            mission=part.mission,
            recordings=recordings,
            sensors=sensors,
        )
        if part.mission is not None:
            story.plan = _plan_beside(path, part.mission.id)
            story.fences = _fences_of(story.plan, configuration, part.mission.id)
        said = comparison_lines(comparison)
        final = part.ended or comparison.final
        result = final.session.result.value
        ended = f"ends in {final.state.value}" + (f" ({result})" if result else "")
        name = path.stem if recordings is None else recordings.bags[0].path.stem
        title = f"Flight {name}"
        return FlightPage(title, content_of(story, title, result, f"{ended}. {said[0]}", said[1:]))
    finally:
        if recordings is not None:
            recordings.close()


def _recording_of(path: Path, sensors: Sensors, memory: int) -> Tuple[Optional[Recordings], int]:
    """Return the bag of a journal, open, and how much later its clock is than the journal's; None: there is no bag.

    It is the one that the journal was read from, or the one that the collector has put beside it, named as its folder.
    """
    bag = path if _is_bag(path) else path.resolve().parent / f"{path.resolve().parent.name}.bag"
    if not bag.is_file():
        return None, 0
    with Recording(bag, memory) as recording:
        topic = next((each.name for each in recording.topics if each.kind == JOURNAL_KIND), None)
    if topic is None:
        return None, 0
    recordings = Recordings([bag], [topic, *sensors.topics], memory=memory)
    log = read_log(tuple(each for each in recordings.bags if isinstance(each, Recording)), topic)
    return recordings, 0 if log is None else log.offset_ns


def _is_bag(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_BAG_MAGIC)) == _BAG_MAGIC


@dataclass(frozen=True)
class _Part:
    """One mission of a journal, which may hold several: what the engine did before and after is on other pages.

    Args:
        begin_ns: when its session began.
        mission: that was flown; None: none was begun.
        end_ns: when the next one's began.
        ended: the state that it ended in; None: it is the journal's last.
    """

    begin_ns: int
    mission: Optional[Mission]
    end_ns: int
    ended: Optional[EngineState] = None

    def holds(self, t_ns: int) -> bool:
        """Return whether a time lies in it; times that are not known do not."""
        return self.begin_ns <= t_ns <= self.end_ns


def _part_of(flown: Sequence[_Part], recorded_ns: Optional[int], end_ns: int) -> _Part:
    """Return the mission during which a recording began; without a recording, the whole journal."""
    begun = [each for each in flown if recorded_ns is not None and each.begin_ns <= recorded_ns]
    return begun[-1] if begun else _Part(0, flown[-1].mission if flown else None, end_ns)


def _later(payload: object, late_ns: int) -> object:
    moves = late_ns != 0 and isinstance(payload, (Event, Decision))
    return evolve(payload, t_ns=max(0, payload.t_ns + late_ns)) if moves else payload  # type: ignore[attr-defined]


def _decided(payloads: Iterable[object], rules: Rules, start_ns: int) -> Tuple[List[Line], List[_Part]]:
    """Decide all events again.

    Returns:
        What was decided and said, and what the monitors said, as a timeline; and the missions that were begun.
    """
    lines: List[Line] = []
    flown: List[_Part] = []
    notes = Notes(lambda t_ns, source, text, level: lines.append(Line(t_ns, source, LineKind.MONITOR, text, level)))
    state = EngineState()
    for event in payloads:
        if not isinstance(event, Event):
            continue
        if isinstance(event, EngineStarted) and not event.resumed:
            state = EngineState()
        if isinstance(event, WatchdogInfo):
            notes.components(event.components, event.t_ns, Source.LOG)
        elif isinstance(event, LandedStatus):
            notes.landed(event.landed, event.reason, event.t_ns, Source.LOG)
        before = state
        state, commands = decide(state, event, rules)
        _note_mission(flown, before, event, state, rules)
        for command in commands:
            if isinstance(command, Decision):
                level = _STATE_LEVELS.get(command.after, 0)
                text = decision_text(command, start_ns)
                lines.append(Line(event.t_ns, Source.LOG, LineKind.DECISION, text, level))
        for command in commands:
            if isinstance(command, Notify):
                level = {Level.INFO: 0, Level.WARNING: 1}.get(command.level, 2)
                lines.append(Line(event.t_ns, Source.LOG, LineKind.MESSAGE, f'"{command.text}"', level))
    return lines, flown


def _note_mission(flown: List[_Part], before: EngineState, event: Event, after: EngineState, rules: Rules) -> None:
    """Note the mission that an event began, and how the one before it ended."""
    if flown:
        flown[-1] = replace(flown[-1], end_ns=event.t_ns)
    if after.session.id in ("", before.session.id):
        return
    if flown:
        flown[-1] = replace(flown[-1], ended=end_on_the_way(before, event, after, rules) or before)
    flown.append(_Part(event.t_ns, after.session.mission, event.t_ns))


_STATE_LEVELS = {State.LAND.value: 2, State.PILOT.value: 2, State.OUTREACH.value: 2, State.HOLD.value: 1}


def _sensors_of_configuration(configuration: Mapping[str, Any]) -> Sensors:
    """Return where the sensors are that an effective configuration names; nothing for one of another version."""
    sensors = configuration.get("sensors", {})
    watched = tuple(
        (topic, name, spec.get("rate_hz"), spec.get("age_limit_s"))
        for name, component in sensors.get("components", {}).items()
        for topic, spec in component.get("topics", {}).items()
    )
    landing, state = sensors.get("landing_detection", {}), sensors.get("state_estimation", {})
    found = Sensors(watched)
    if landing.get("topic") and landing.get("source") == "range":
        limits = landing.get("scale", 1.0), landing.get("max_range_m", math.inf)
        found = found._replace(range=(landing["topic"], "range", *limits))
    if state.get("imu_topic"):
        roll, pitch, yaw = (math.radians(each) for each in state.get("imu_mounting_rpy_deg", (0.0, 0.0, 0.0)))
        up = rotation_from_rpy((roll, pitch, yaw))[2]
        found = found._replace(imu=(state["imu_topic"], *_IMU_FIELDS.values(), 1.0, up))
    if state.get("topic"):
        found = found._replace(estimate=(state["topic"], EstimateSource(state.get("source", "odometry"))))
    return found


def _fences_of(plan: Optional[MissionPlan], configuration: Mapping[str, Any], mission_id: str) -> Sequence[Fence]:
    """Return the fences of a mission; of one whose files are not there, the one in the effective configuration."""
    if plan is not None:
        return plan.fences
    missions = configuration.get("missions", {}).get("missions", {})
    corners = missions.get(mission_id, {}).get("fence_m", ())
    return [Fence((Polygon(tuple((float(x), float(y)) for x, y in corners)),))] if corners else []


def _plan_beside(path: Path, mission_id: str) -> Optional[MissionPlan]:
    """Return the mission of the configuration that the collector has put beside a recording; None: none is there."""
    folder = path.parent / "configuration"
    if not folder.is_dir():
        return None
    with suppress(ConfigError, KeyError, OSError):
        return load_configuration(folder).plan(mission_id)
    return None
