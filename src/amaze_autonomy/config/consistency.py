"""What must be true between files, and between names and what they name."""

from __future__ import annotations

import difflib
import re
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Tuple

from .binding import refuse_at
from .kinds import Address, Places

__all__ = [
    "check_autonomy_with_sensors",
    "check_heights",
    "check_known",
    "check_planner",
    "check_recording",
    "unrecorded_topics",
]

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


def check_recorder_limits(autonomy: Mapping[str, Any], recording: Mapping[str, Any], places: Places) -> None:
    """Check that the recorder says what is missing before the engine stops waiting; `places` are of recording.yaml.

    Raises:
        ConfigError: about the recorder's limit.
    """
    limit, own = autonomy["recording"]["recording_start_limit_s"], recording["start_limit_s"]
    if own >= limit and ("start_limit_s",) in places:
        right = f"must be below recording.recording_start_limit_s of autonomy.yaml ({limit:g}), or nobody hears why"
        refuse_at(("start_limit_s",), places, f"is {own:g}", right)


def check_recording(values: Mapping[str, Any], places: Places) -> None:
    """Check that platforms record groups that exist, and every topic once.

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


def _watched(sensors: Mapping[str, Any]) -> Iterator[Tuple[str, str, str]]:
    """Yield topics of sensors.yaml that are meant to be recorded, each once: name, whose it is, and another way out."""
    seen = set()
    for name, component in sensors["components"].items():
        for topic, values in component["topics"].items():
            seen.add(topic)
            if values["recorded"]:
                yield topic, f"component {name}", ", or `recorded: false` to the topic in sensors.yaml"
    for check, key in (
        ("landing_detection", "topic"),
        ("state_estimation", "topic"),
        ("state_estimation", "imu_topic"),
    ):
        topic = sensors[check][key]
        if topic and topic not in seen:
            seen.add(topic)
            yield topic, f"{check}.{key}", ""


def _records(group: Mapping[str, Any], topic: str) -> bool:
    """Return whether a group records a topic; rosbag matches its expressions as a whole."""
    if topic in group["topics"]:
        return True
    if group["exclude"] and re.fullmatch(group["exclude"], topic):
        return False
    return any(re.fullmatch(pattern, topic) for pattern in group["match"])
