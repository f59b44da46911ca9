"""What must be true between files, and between names and what they name."""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from typing import Any, Dict, Iterable, Iterator, List, Mapping, NoReturn, Optional, Tuple

from ..engine.rules import SEVERITIES, Action, Severity
from ..interface.fields import MOST_ITEMS
from ..missions import Controller, FlightModel, Frame, climb_s
from ..monitoring.component import return_time
from ..monitoring.restart import why_kept
from ..monitoring.specs import ComponentSpec, RangeSource, RestartPolicy, TopicSpec
from .errors import ConfigError
from .kinds import Address, Places
from .schema import make, refuse_at
from .schemas.recording import Recording

_S = 1_000_000_000
_ANSWER_S = 1.0  # beyond the planner's own limit


def check_autonomy_with_sensors(autonomy: Mapping[str, Any], sensors: Mapping[str, Any], places: Places) -> None:
    """Check what sensors.yaml says against the engine's limits; `places` are those of sensors.yaml.

    Raises:
        ConfigError: about the first key that cannot be.
    """
    fix = autonomy["checks"]["preflight_fix_limit_s"]
    for name, component in sensors["components"].items():
        restart = component["restart"]
        if restart["policy"] != "never" and restart["total_limit_s"] > fix:
            right = f"must be at most checks.preflight_fix_limit_s of autonomy.yaml ({fix:g}), or it is not waited for"
            at = ("components", name, "restart", "total_limit_s")
            refuse_at(at, places, f"is {restart['total_limit_s']:g}", right)
    critical, least = autonomy["battery"]["battery_critical_fraction"], sensors["battery"]["minimum_fraction"]
    if least < critical:
        right = (
            f"must be at least battery.battery_critical_fraction of autonomy.yaml ({critical:g}): it would land at once"
        )
        refuse_at(("battery", "minimum_fraction"), places, f"is {least:g}", right)


def check_heights(autonomy: Mapping[str, Any], missions: Mapping[str, Any], places: Places) -> None:
    """Check that a landing from the height limit fits its time limit; `places` are those of missions.yaml.

    Raises:
        ConfigError: about the landing speed, or the mission's own height limit.
    """
    limit, speed = autonomy["landing"]["land_limit_s"], missions["flight"]["landing_speed_m_s"]
    height = autonomy["flight"]["max_height_m"]
    if height / speed > limit:
        right = f"must be at least {height / limit:.6g}: else landing from {height:g} m takes longer than {limit:g} s"
        refuse_at(("flight", "landing_speed_m_s"), places, f"is {speed:g}", right)
    for mission_id, mission in missions["missions"].items():
        own = mission["limits"]["max_height_m"]
        if own is not None and own / speed > limit:
            at = ("missions", mission_id, "limits", "max_height_m")
            right = f"must be at most {limit * speed:g}: landing takes longer than {limit:g} s (land_limit_s)"
            refuse_at(at, places, f"is {own:g}", right)


def check_takeoff(autonomy: Mapping[str, Any], missions: Mapping[str, Any], places: Places) -> None:
    """Check that a takeoff fits the times that the engine gives it; `places` are those of missions.yaml.

    Raises:
        ConfigError: about the climb, or about the set-points that come before the arming.
    """
    takeoff, flight = autonomy["takeoff"], missions["flight"]
    height, limit = takeoff["takeoff_height_m"], takeoff["takeoff_limit_s"]
    needed = climb_s(height, FlightModel(**flight))
    if needed >= limit:
        right = (
            f"must be more: the climb to {height:g} m (takeoff_height_m) takes {needed:.3g} s, "
            f"and is ended after {limit:g} s (takeoff_limit_s)"
        )
        refuse_at(("flight", "climb_speed_m_s"), places, f"is {flight['climb_speed_m_s']:g}", right)
    lead, limit = missions["planner"]["setpoint_lead_s"], takeoff["arm_limit_s"]
    offboard = any(mission["controller"] == Controller.OFFBOARD.value for mission in missions["missions"].values())
    if offboard and lead > limit / 2:
        right = f"must be at most {limit / 2:g}, half of takeoff.arm_limit_s of autonomy.yaml ({limit:g})"
        refuse_at(("planner", "setpoint_lead_s"), places, f"is {lead:g}", f"{right}: it is armed after that")


def check_planner(autonomy: Mapping[str, Any], missions: Mapping[str, Any], places: Places) -> None:
    """Check that the planner gives up before the engine does, and repeats before it gives up.

    Raises:
        ConfigError: about the first key that cannot be.
    """
    planner, limit = missions["planner"], autonomy["takeoff"]["load_limit_s"]
    if planner["transfer_limit_s"] + _ANSWER_S > limit:
        right = f"must be at most {limit - _ANSWER_S:g}: the engine waits for {limit:g} s (load_limit_s)"
        refuse_at(("planner", "transfer_limit_s"), places, f"is {planner['transfer_limit_s']:g}", right)
    for pause, whole in (("message_retry_s", "transfer_limit_s"), ("command_retry_s", "command_limit_s")):
        if planner[pause] * 2 > planner[whole]:
            right = f"must be at most half of {whole} ({planner[whole]:g}), or nothing is sent again"
            refuse_at(("planner", pause), places, f"is {planner[pause]:g}", right)


def check_required(sensors: Mapping[str, Any], missions: Mapping[str, Any], places: Places) -> None:
    """Check that each mission needs something before takeoff: an empty list would stand for all.

    Raises:
        ConfigError: about a mission that lists nothing where no component is required; `places` are of missions.yaml.
    """
    if any(component["required"] for component in sensors["components"].values()):
        return
    for mission_id, mission in missions["missions"].items():
        if not mission["required"]:
            wrong = "is empty, and every component of sensors.yaml has required: false"
            right = "must list what must work before takeoff, or one of those must be required"
            refuse_at(("missions", mission_id, "required"), places, wrong, right)


def check_initialisation(autonomy: Mapping[str, Any], sensors: Mapping[str, Any], places: Places) -> None:
    """Check that an estimator that does not begin is noticed before the engine stops waiting; `places` of sensors.yaml.

    Raises:
        ConfigError: about the limit of the estimator.
    """
    limit, own = autonomy["checks"]["preflight_fix_limit_s"], sensors["initialisation"]["limit_s"]
    if sensors["initialisation"]["service"] and own >= limit:
        right = f"must be below checks.preflight_fix_limit_s of autonomy.yaml ({limit:g}), or it is not waited for"
        refuse_at(("initialisation", "limit_s"), places, f"is {own:g}", right)


def check_replies(autonomy: Mapping[str, Any], autopilot: Mapping[str, Any], places: Places) -> None:
    """Check that the autopilot node answers before the engine stops waiting; `places` are of autopilot.yaml.

    Raises:
        ConfigError: about the time in which it answers.
    """
    limit, own = autonomy["commands"]["command_reply_limit_s"], autopilot["commands"]["reply_s"]
    if own >= limit:
        right = f"must be below commands.command_reply_limit_s of autonomy.yaml ({limit:g}), or no answer comes in time"
        refuse_at(("commands", "reply_s"), places, f"is {own:g}", right)


def check_known(names: Iterable[str], known: Iterable[str], what: str, here: Address, places: Places) -> None:
    """Check that every name is known; `here` is the address of the list, or of the group whose keys they are.

    Raises:
        ConfigError: with the name that was probably meant.
    """
    there = list(known)
    for position, name in enumerate(names):
        if name not in there:
            at = next((each for each in ((*here, str(position)), (*here, name)) if each in places), here)
            close = difflib.get_close_matches(name, there, n=1)
            right = f"did you mean {close[0]}?" if close else f"known: {', '.join(there)}"
            refuse_at(at, places, f"{name} is not a {what}", right)


def check_recorder_limits(
    autonomy: Mapping[str, Any], recording: Mapping[str, Any], places: Mapping[str, Places]
) -> None:
    """Check that the recorder says what is missing before the engine stops waiting; `places` are of all files.

    Raises:
        ConfigError: about the recorder's limit; about the engine's where the recorder's is left out.
    """
    limit, own = autonomy["recording"]["recording_start_limit_s"], recording["start_limit_s"]
    if own < limit:
        return
    if ("start_limit_s",) not in places["recording"]:
        right = f"must be above start_limit_s of recording.yaml ({own:g}), or nobody hears why"
        refuse_at(("recording", "recording_start_limit_s"), places["autonomy"], f"is {limit:g}", right)
    right = f"must be below recording.recording_start_limit_s of autonomy.yaml ({limit:g}), or nobody hears why"
    refuse_at(("start_limit_s",), places["recording"], f"is {own:g}", right)


def check_platform_limit(autonomy: Mapping[str, Any], recording: Mapping[str, Any], places: Places) -> None:
    """Check that a platform is not silent between two of its statuses; `places` are those of recording.yaml.

    Raises:
        ConfigError: about the limit of its silence.
    """
    rate = "streams.recorder_status_rate_hz"
    least, own = _PERIODS / _value(autonomy, rate), recording["platform_limit_s"]
    if own < least:
        right = (
            f"must be at least {least:g}, {_PERIODS} periods of {rate} of autonomy.yaml: one lost message is no loss"
        )
        refuse_at(("platform_limit_s",), places, f"is {own:g}", right)


def check_recording(values: Mapping[str, Any], places: Places) -> None:
    """Check that platforms record groups that exist, each topic once and none that is excluded, and what may be lost.

    Raises:
        ConfigError: about the first key that cannot be.
    """
    check_known([values["collector"]], values["platforms"], "platform", ("collector",), places)
    recorded: Dict[str, str] = {}
    for platform, content in values["platforms"].items():
        if content["transfer"]["by"] == "rsync" and not content["transfer"]["host"]:
            at = ("platforms", platform, "transfer", "host")
            refuse_at(at, places, "is missing", "must be given for rsync: the other computer, as ssh knows it")
        here = ("platforms", platform, "groups")
        check_known(content["groups"], values["groups"], "group", here, places)
        for group in content["groups"]:
            for position, topic in enumerate(values["groups"][group]["topics"]):
                if topic in recorded:
                    at = ("groups", group, "topics", str(position))
                    wrong = f"{topic} is recorded by {recorded[topic]} and by {platform} in {group}"
                    refuse_at(at, places, wrong, "must be recorded once: the merged recording would have it twice")
                recorded[topic] = f"{platform} in {group}"
    for group in values["groups"]:
        if not any(group in content["groups"] for content in values["platforms"].values()):
            refuse_at(("groups", group), places, "is recorded by no platform", "must be in the groups of one")
        _check_excluded(group, values["groups"][group], places)
    for position, topic in enumerate(values["tolerated_topics"]):
        if not any(_records(group, topic) for group in values["groups"].values()):
            close = difflib.get_close_matches(topic, list(recorded), n=1)
            right = f"did you mean {close[0]}?" if close else "must be a topic of a group"
            refuse_at(("tolerated_topics", str(position)), places, f"{topic} is recorded by no group", right)


def _check_excluded(name: str, group: Mapping[str, Any], places: Places) -> None:
    """Check that a group records its topics: rosbag looks at what is excluded before anything else."""
    for position, topic in enumerate(group["topics"]):
        if not _records(group, topic):
            at = ("groups", name, "topics", str(position))
            refuse_at(at, places, f"{topic} is excluded by {group['exclude']}", "must not be: it would not be recorded")


def unrecorded_topics(sensors: Mapping[str, Any], recording: Mapping[str, Any]) -> List[str]:
    """Return a line for each topic that is watched and that no group records, with what to write.

    It is no mistake, but what failed in a flight is then missing from its recording, and nobody can replay it.
    """
    groups = recording["groups"].values()
    return [
        f"{topic} ({whose}) is watched, and no group of recording.yaml records it: add the line `- {topic}` to the "
        f"topics of a group{otherwise}"
        for topic, whose, otherwise in _watched(sensors)
        if not any(_records(group, topic) for group in groups)
    ]


def taken_in_place(recording: Recording) -> List[str]:
    """Return a line for each platform of which nothing is said how the collector gets what it has recorded.

    It is no mistake: two recorders may write on one computer. On two, the flight is over when it shows.
    """
    return [
        f"platforms.{each.name} of recording.yaml does not say how {recording.collector} gets its recordings "
        f"(transfer.by), which are used in place then: is its folder on a disk of {recording.collector}? If so, write "
        "`transfer: {by: here}`, else rsync or shared"
        for each in recording.platforms
        if each.name != recording.collector and not each.has_transfer
    ]


_STATE_TOPICS = ("topic", "imu_topic")
_MOST_PERIODS = 100
_ALIKE = 0.85
MAVROS_TOPIC = re.compile(r"(.*/mavros)/.+")
_SHOWN = 7
_STREAM_LOST = "COM_OBL_RC_ACT"  # what PX4 does when set-points stop
_BY_HARM = tuple(Severity)
_LANDING_M = 2.0  # so far beside the last waypoint a good landing may end


def contradictions(effective: Mapping[str, Any]) -> List[str]:
    """Return a line for what each file may say and all of them together do not mean, with what to write.

    None of it is certain to be a mistake, so that none refuses the configuration.
    """
    sensors, recording = effective["sensors"], effective["recording"]
    topics = {
        topic: (f"components.{name}", values)
        for name, component in sensors["components"].items()
        for topic, values in component["topics"].items()
    }
    return [
        *_never_silent(topics),
        *_blind_landing(sensors, topics),
        *_misspelled(sensors, recording),
        *_mavros_elsewhere(effective["autopilot"], sensors, recording),
        *_loaded_too_soon(effective["autonomy"]),
        *_loaded_nowhere(effective["missions"]),
        *_left_to_chance(effective["autopilot"], effective["missions"]),
        *_ended_with_another(sensors["components"], effective["missions"]["missions"]),
    ]


def _never_silent(topics: Mapping[str, Tuple[str, Any]]) -> Iterator[str]:
    for topic, (component, values) in topics.items():
        periods = values["age_limit_s"] * values["rate_hz"]
        if periods > _MOST_PERIODS:
            yield (
                f"{component}: {topic} may be silent for {values['age_limit_s']:g} s, {periods:.0f} periods of its "
                f"{values['rate_hz']:g} Hz, before it has failed: is age_limit_s what you mean?"
            )


def _blind_landing(sensors: Mapping[str, Any], topics: Mapping[str, Tuple[str, Any]]) -> Iterator[str]:
    landing = sensors["landing_detection"]
    topic = landing["topic"]
    if topic not in topics:
        yield (
            f"landing_detection.topic is {topic}, and no component has that topic: nobody says when it fails; add it "
            f"to a component, or name the topic that one has{_meant(topic, topics)}"
        )
    if landing["source"] != RangeSource.POSE.value and landing["min_range_m"] <= 0.0:
        yield (
            "landing_detection.min_range_m is 0: a range finder that says 0 where it sees nothing, or is dead, would "
            "be on the ground, in the air too; give the least distance that it measures, e.g. 0.02"
        )


def unnamed_topics(effective: Mapping[str, Any], named: Iterable[str]) -> List[str]:
    """Return a line for each group that records what nothing names: nobody would miss it.

    Args:
        effective: the configuration.
        named: what nodes of ours and maps name, as they do; it may be in a namespace.
    """
    sensors, recording = effective["sensors"], effective["recording"]
    meant, names = _meant_by(sensors, recording), [*_known(sensors), *named]
    ends = tuple(_resolved(name) for name in names if not name.startswith("/"))
    lines = []
    for group, values in recording["groups"].items():
        left = [each for each in values["topics"] if each not in (*names, *meant) and not each.endswith(ends or "\n")]
        if left:
            more = f" and {len(left) - _SHOWN} more" if len(left) > _SHOWN else ""
            lines.append(
                f"groups.{group} of recording.yaml records {', '.join(left[:_SHOWN])}{more}, which no sensor, no node "
                "of ours and no map names: is each spelled as its node has it?"
            )
    return lines


def _known(sensors: Mapping[str, Any]) -> List[str]:
    """Return the topics that sensors.yaml names."""
    checked = (sensors["landing_detection"]["topic"], *(sensors["state_estimation"][key] for key in _STATE_TOPICS))
    watched = (topic for component in sensors["components"].values() for topic in component["topics"])
    return sorted({*watched, *checked} - {""})


def _meant_by(sensors: Mapping[str, Any], recording: Mapping[str, Any]) -> Dict[str, str]:
    """Return the recorded topics that nothing of sensors.yaml is, with that which each resembles and nobody records."""
    groups, known = recording["groups"].values(), _known(sensors)
    lost = [topic for topic in known if not any(_records(group, topic) for group in groups)]
    recorded = [topic for group in groups for topic in group["topics"] if topic not in known]
    close = {topic: difflib.get_close_matches(topic, lost, n=1, cutoff=_ALIKE) for topic in recorded}
    return {topic: found[0] for topic, found in close.items() if found}


def _misspelled(sensors: Mapping[str, Any], recording: Mapping[str, Any]) -> Iterator[str]:
    meant = _meant_by(sensors, recording)
    for name, group in recording["groups"].items():
        for topic in (topic for topic in group["topics"] if topic in meant):
            yield f"groups.{name} of recording.yaml records {topic}, which nobody has: did you mean {meant[topic]}?"


def _mavros_elsewhere(
    autopilot: Mapping[str, Any], sensors: Mapping[str, Any], recording: Mapping[str, Any]
) -> Iterator[str]:
    recorded = (topic for group in recording["groups"].values() for topic in group["topics"])
    found = ((topic, MAVROS_TOPIC.fullmatch(topic)) for topic in sorted({*_known(sensors), *recorded}))
    others = [topic for topic, match in found if match is not None and match[1] != autopilot["mavros"]]
    if autopilot["backend"] == "mavros" and others:
        yield (
            f"autopilot.yaml says that mavros is at {autopilot['mavros']}, and sensors.yaml and recording.yaml have "
            f"{', '.join(others)}: is it that of another vehicle, or is one of the two names wrong?"
        )


def _loaded_too_soon(autonomy: Mapping[str, Any]) -> Iterator[str]:
    limit_s = autonomy["takeoff"]["load_limit_s"]
    for key, reply_s in _reply_limits(autonomy):
        if limit_s <= reply_s:
            yield (
                f"takeoff.load_limit_s ({limit_s:g}) is not above {key} ({reply_s:g}): the checks are asked again "
                "while the mission is loaded, and one that takes its time ends the takeoff"
            )


def _loaded_nowhere(missions: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line where a later file may be refused for a landing that is as good as others are."""
    planner = missions["planner"]
    tolerance_m, needed_m = planner["home_tolerance_m"], planner["acceptance_radius_m"] + _LANDING_M
    several = [name for name, each in missions["missions"].items() if _takes_off_again(each)]
    if several and tolerance_m < needed_m:
        yield (
            f"missions.yaml: planner.home_tolerance_m is {tolerance_m:g}, and mission {several[0]} takes off more than "
            "once: a later file is loaded only so near to where the one before ends, and a landing may be "
            f"{needed_m:g} m off"
        )


def _left_to_chance(autopilot: Mapping[str, Any], missions: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line where set-points may stop in flight and nobody has looked what the autopilot does then."""
    compared = {**autopilot["parameters"], **autopilot["offboard_parameters"]}
    by_setpoints = [
        name for name, each in missions["missions"].items() if each["controller"] == Controller.OFFBOARD.value
    ]
    if by_setpoints and _STREAM_LOST not in compared:
        yield (
            f"missions.yaml: mission {by_setpoints[0]} is flown by set-points, and {_STREAM_LOST} is compared in "
            "neither offboard_parameters nor parameters of autopilot.yaml: a PX4 does what it happens to be set to "
            f"when they stop, in flight; add `offboard_parameters: {{{_STREAM_LOST}: 4}}` (4 is to land)"
        )


def _ended_with_another(components: Mapping[str, Any], missions: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line where a restart makes another component fail that is landed for, and its own is not so bad."""
    for name in (each for each, values in components.items() if values["restart"]["policy"] == "node"):
        node = components[name]["node"]
        for other in (each for each, values in components.items() if values["node"] == node and each != name):
            mission = next((each for each in missions if _lands_rather(components, missions[each], other, name)), None)
            if mission is not None:
                yield (
                    f"components.{name} of sensors.yaml is restarted by its node {node}, which is that of {other}, "
                    f"too: in flight that makes {other} fail, for which mission {mission} lands; give {name} another "
                    f"policy, or {other} no worse a severity"
                )


def _lands_rather(components: Mapping[str, Any], mission: Mapping[str, Any], one: str, other: str) -> bool:
    """Return whether a mission is landed for one component, and the other's severity is not so bad."""
    one_bad, other_bad = (
        Severity(mission["severities"].get(each, components[each]["severity"])) for each in (one, other)
    )
    row = SEVERITIES[one_bad]
    return Action.LAND in (row.action, row.fallback) and _BY_HARM.index(one_bad) > _BY_HARM.index(other_bad)


def _takes_off_again(mission: Mapping[str, Any]) -> bool:
    flights = (len(mission["files"]) if mission["touchdown_between_files"] else 1) * mission["repetitions"]
    return bool(flights > 1 and mission["frame"] != Frame.START_HEADING.value)


def _reply_limits(autonomy: Mapping[str, Any]) -> Iterator[Tuple[str, float]]:
    """Yield the limits of answers to checks: of all of them, then of those that have their own."""
    checks = autonomy["checks"]
    yield "checks.check_reply_limit_s", checks["check_reply_limit_s"]
    for check, limit_s in checks["reply_limits_s"].items():
        yield f"checks.reply_limits_s.{check}", limit_s


def _meant(topic: str, topics: Iterable[str]) -> str:
    close = difflib.get_close_matches(topic, list(topics), n=1)
    return f"; did you mean {close[0]}?" if close else ""


def _watched(sensors: Mapping[str, Any]) -> Iterator[Tuple[str, str, str]]:
    """Yield topics of sensors.yaml that are meant to be recorded, each once: name, whose it is, and another way out."""
    seen = set()
    for name, component in sensors["components"].items():
        for topic, values in component["topics"].items():
            seen.add(topic)
            if values["recorded"]:
                yield topic, f"component {name}", ", or `recorded: false` to the topic in sensors.yaml"
    for check, key in (("landing_detection", "topic"), *(("state_estimation", key) for key in _STATE_TOPICS)):
        topic = sensors[check][key]
        if topic and topic not in seen:
            seen.add(topic)
            yield topic, f"{check}.{key}", ""


def _resolved(topic: str) -> str:
    """Return the whole name of a topic outside of any namespace; `~` stands for the autonomy node."""
    return "/" + topic.replace("~", "autonomy/").lstrip("/")


def _records(group: Mapping[str, Any], topic: str) -> bool:
    """Return whether a group records a topic; rosbag matches its expressions as a whole, what is excluded first.

    To rosbag the name of a topic is resolved.
    """
    resolved = _resolved(topic)
    if group["match"] and group["exclude"] and re.fullmatch(group["exclude"], resolved):
        return False
    return topic in group["topics"] or any(re.fullmatch(pattern, resolved) for pattern in group["match"])


# --- order ------------------------------------------------------------------------------------------------------------
# Which limit of autonomy.yaml must not be above which other: a table, and the check of it.


@dataclass(frozen=True)
class Order:
    """One value must not be above another.

    Args:
        low: address of the one, dotted.
        high: address of the other.
        equal: they may be equal.
        reason: why.
    """

    low: str
    high: str
    equal: bool
    reason: str


ORDER: Tuple[Order, ...] = (
    Order("checks.preflight_fix_poll_s", "checks.preflight_fix_limit_s", False, "else the fix is never asked for"),
    Order("checks.check_reply_limit_s", "checks.check_max_age_s", False, "else a slow answer is too old when it comes"),
    Order("recording.recording_lead_s", "recording.recording_start_limit_s", False, "else no recording starts in time"),
    Order("takeoff.takeoff_height_m", "flight.max_height_m", False, "else every takeoff ends in a landing"),
    Order("landing.land_repeat_period_s", "landing.land_second_route_after_s", False, "LAND is repeated before"),
    Order("landing.descent_time_s", "landing.land_second_route_after_s", False, "else no descent is seen before"),
    Order("landing.land_second_route_after_s", "landing.land_alarm_after_s", True, "the pilot is the last route"),
    Order("landing.land_alarm_after_s", "landing.land_limit_s", False, "the pilot needs time to land it"),
    Order("landing.ground_disarm_after_s", "landing.confirm_limit_s", False, "else it is never disarmed in time"),
    Order("landing.confirm_limit_s", "landing.land_limit_s", False, "the pilot needs time to stop the motors"),
    Order("failsafe.clock_tolerance_s", "failsafe.status_max_age_s", False, "else the future passes for the present"),
    Order(
        "battery.battery_critical_fraction", "battery.battery_reserve_fraction", True, "else every mission ends by it"
    ),
    Order("flight.tilt_warning_deg", "flight.max_tilt_deg", True, "else it lands without a warning before"),
    Order(
        "commands.hold_repeat_after_s",
        "commands.hold_confirm_limit_s",
        False,
        "else one lost request ends in a landing",
    ),
    Order("commands.user_hold_limit_s", "flight.max_flight_time_s", False, "else a hold outlasts the flight"),
)

# limit of a loss, rate of the messages whose absence it is
LOSS_RATES: Tuple[Tuple[str, str], ...] = (
    ("failsafe.watchdog_heartbeat_limit_s", "streams.watchdog_action_rate_hz"),
    ("failsafe.planner_status_limit_s", "streams.planner_status_rate_hz"),
    ("failsafe.autopilot_status_limit_s", "streams.autopilot_status_rate_hz"),
    ("failsafe.status_max_age_s", "streams.autopilot_status_rate_hz"),
    ("failsafe.landing_detection_limit_s", "streams.landing_detection_rate_hz"),
    ("failsafe.recorder_status_limit_s", "streams.recorder_status_rate_hz"),
)
_PERIODS = 2


def _value(values: Mapping[str, Any], address: str) -> float:
    group, key = address.split(".")
    return float(values[group][key])


def _check_own_replies(values: Mapping[str, Any], places: Places) -> None:
    """Check the limits that checks have for themselves, as those of all."""
    order = next(each for each in ORDER if each.low == "checks.check_reply_limit_s")
    replies, ages = values["checks"]["reply_limits_s"], values["checks"]["max_ages_s"]
    for check in sorted({*replies, *ages}):
        low = f"checks.reply_limits_s.{check}" if check in replies else order.low
        high = f"checks.max_ages_s.{check}" if check in ages else order.high
        reply_s, age_s = replies.get(check, _value(values, order.low)), ages.get(check, _value(values, order.high))
        if reply_s >= age_s:
            key, is_s, right = (low, reply_s, f"below {high} ({age_s:g})")
            if check not in replies:
                key, is_s, right = (high, age_s, f"above {low} ({reply_s:g})")
            refuse_at(tuple(key.split(".")), places, f"is {is_s:g}", f"must be {right}: {order.reason}")


def check_order(values: Mapping[str, Any], places: Places) -> None:
    """Check the limits of the engine against each other.

    Raises:
        ConfigError: about the key of the pair that the file gives; about the lower one when it gives both.
    """
    for order in ORDER:
        low, high = _value(values, order.low), _value(values, order.high)
        if low > high or (low == high and not order.equal):
            _out_of_order(order, low, high, places)
    _check_own_replies(values, places)
    for limit, rate in LOSS_RATES:
        least = _PERIODS / _value(values, rate)
        if _value(values, limit) < least:
            right = f"must be at least {least:g}, {_PERIODS} periods of {rate}: one lost message is no loss"
            refuse_at(tuple(limit.split(".")), places, f"is {_value(values, limit):g}", right)


def _out_of_order(order: Order, low: float, high: float, places: Places) -> NoReturn:
    one, other = tuple(order.low.split(".")), tuple(order.high.split("."))
    if one not in places and other in places:
        word = "at least" if order.equal else "above"
        refuse_at(other, places, f"is {high:g}", f"must be {word} {order.low} ({low:g}): {order.reason}")
    word = "at most" if order.equal else "below"
    refuse_at(one, places, f"is {low:g}", f"must be {word} {order.high} ({high:g}): {order.reason}")


# --- decision table ---------------------------------------------------------------------------------------------------
# The rules of the decision table: what a component's row may say, and what would never work.


def waits(severity: str) -> bool:
    """Return whether a flight waits for a component of this severity."""
    return SEVERITIES[Severity(severity)].action is Action.WAIT


def check_components(components: Mapping[str, Any], places: Places) -> None:
    """Check each row of the decision table.

    Raises:
        ConfigError: about the first key that cannot be.
    """
    if len(components) > MOST_ITEMS:
        refuse_at(
            ("components",),
            places,
            f"has {len(components)}",
            f"must have at most {MOST_ITEMS}: a message lists no more",
        )
    for name, component in components.items():
        here = ("components", name)
        _check_sources(component, here, places)
        _check_restart(component, here, places)
        _check_wait(component, here, places)
        for topic, values in component["topics"].items():
            _check_topic(values, (*here, "topics", topic), places)


def _check_sources(component: Mapping[str, Any], here: Address, places: Places) -> None:
    if not (component["topics"] or component["node"] or component["driver"] or component["autopilot"]):
        right = "must have a source: topics, node, driver or autopilot; nothing would be watched"
        refuse_at(here, places, "has no source", right)
    if component["autopilot"] and component["group"] != "px4":
        right = f"must be px4: the autopilot says how its {component['autopilot']} is"
        refuse_at((*here, "group"), places, f"is {component['group']}", right)


def _check_restart(component: Mapping[str, Any], here: Address, places: Places) -> None:
    restart, at = component["restart"], (*here, "restart")
    policy = restart["policy"]
    if component["group"] == "px4" and policy != "never":
        right = "must be never in group px4: the vehicle would be uncontrollable"
        refuse_at((*at, "policy"), places, f"is {policy}", right)
    if policy == "node" and not component["node"]:
        refuse_at(
            (*at, "policy"), places, "is node", "must be another one, or node must be given: there is none to restart"
        )
    if policy in ("driver", "command") and not restart["command"]:
        right = f"must be given with the policy {policy}: program and arguments"
        refuse_at((*at, "command"), places, "is missing", right)
    if policy in ("never", "node") and restart["command"]:
        right = "must be left out, or the policy must be driver or command"
        refuse_at((*at, "command"), places, f"is given with the policy {policy}", right)
    if restart["total_limit_s"] < restart["attempt_limit_s"]:
        right = f"must be at least attempt_limit_s ({restart['attempt_limit_s']:g})"
        refuse_at((*at, "total_limit_s"), places, f"is {restart['total_limit_s']:g}", right)


def check_restarted_nodes(
    components: Mapping[str, Any], autopilot: Optional[Mapping[str, Any]], places: Places
) -> None:
    """Check that no node is restarted that the vehicle needs; `places` are those of sensors.yaml.

    Raises:
        ConfigError: about the policy of the component that asks for it.
    """
    px4 = {each["node"]: name for name, each in components.items() if each["group"] == "px4" and each["node"]}
    link = autopilot["mavros"] if autopilot is not None and autopilot["backend"] == "mavros" else ""
    for name, component in components.items():
        kept = why_kept(component["node"], px4, link) if component["restart"]["policy"] == "node" else ""
        if kept:
            right = (
                f"must be another one, or another node: {kept}, and is never ended: the vehicle would be uncontrollable"
            )
            refuse_at(("components", name, "restart", "policy"), places, "is node", right)


def _check_wait(component: Mapping[str, Any], here: Address, places: Places) -> None:
    at, wait, severity = (*here, "wait_limit_s"), component["wait_limit_s"], component["severity"]
    if waits(severity) and wait is None:
        right = f"must be given: with severity {severity} a flight waits, and every wait has a limit"
        refuse_at(at, places, "is missing", right)
    if not waits(severity) and wait is not None:
        what = "flown on without" if SEVERITIES[Severity(severity)].action is Action.CONTINUE else "landed for at once"
        right = f"must be left out: with severity {severity} it is {what}, nobody waits"
        refuse_at(at, places, f"is {wait:g}", right)
    restart = component["restart"]
    if wait is not None and restart["policy"] != "never" and wait < restart["attempt_limit_s"]:
        right = (
            f"must be at least restart.attempt_limit_s ({restart['attempt_limit_s']:g}): no restart would end in time"
        )
        refuse_at(at, places, f"is {wait:g}", right)


def returns_after_s(topics: Mapping[str, Mapping[str, Any]]) -> float:
    """Return how long topics need to be back, of their rows in sensors.yaml; 0 where a row is refused in any case."""
    try:
        specs = tuple(make(TopicSpec, values, (), {}, topic=name) for name, values in topics.items())
    except ConfigError:
        return 0.0
    return return_time(ComponentSpec("component", topics=specs, node="/node"))[0] / _S


def check_returns(components: Iterable[ComponentSpec], places: Places) -> None:
    """Check that what works again counts as back before nobody waits for it any more; `places` are of sensors.yaml.

    Raises:
        ConfigError: about the limit of the restart, else about that of the wait.
    """
    for spec in components:
        restart, start = spec.restart, ""
        at: Address = ("components", spec.name, "wait_limit_s")
        limit_ns = spec.wait_limit_ns
        if restart.policy is not RestartPolicy.NEVER:  # no wait is shorter than an attempt
            at, limit_ns = ("components", spec.name, "restart", "attempt_limit_s"), restart.attempt_limit_ns
            start = ", and the time of a start"
        elif not limit_ns:
            continue
        needed = returns_too_late(spec, limit_ns, start)
        if needed:
            refuse_at(at, places, f"is {limit_ns / _S:g}", f"must be {needed}")


def returns_too_late(spec: ComponentSpec, limit_ns: int, start: str = "") -> str:
    """Return what a limit must be, for a component that would not count as back within it; empty: it would."""
    needed_ns, source = return_time(spec)
    if limit_ns > needed_ns:
        return ""
    return f"above {needed_ns / _S:.6g}{start}: so long it takes until {source} counts as back"


def _check_topic(values: Mapping[str, Any], here: Address, places: Places) -> None:
    period = 1.0 / values["rate_hz"]
    if values["age_limit_s"] < 3 * period - 1e-9:
        right = f"must be at least {3 * period:.6g}, three periods of rate_hz: one or two lost messages are no failure"
        refuse_at((*here, "age_limit_s"), places, f"is {values['age_limit_s']:g}", right)
    if values["window_s"] is not None and values["window_s"] < 4 * period - 1e-9:
        right = f"must be at least {4 * period:.6g}, four periods of rate_hz"
        refuse_at((*here, "window_s"), places, f"is {values['window_s']:g}", right)
    most = 1.0 - values["tolerance_fraction"]
    if not values["rate_failed_fraction"] < most:
        right = f"must be below 1 - tolerance_fraction ({most:g}): a slow topic comes before a failed one"
        refuse_at((*here, "rate_failed_fraction"), places, f"is {values['rate_failed_fraction']:g}", right)
