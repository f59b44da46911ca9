"""The private parameters of the autonomy node."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Tuple

import rospy

from amaze_autonomy.paths import config_folder

from .errors import StartError

__all__ = ["Parameters", "configuration_folder", "overrides", "read_parameters"]


@dataclass(frozen=True)
class Parameters:
    """What the launch file says to the node.

    Args:
        config: folder of the configuration.
        overrides: keys of the configuration that are to be different: "file.group.key=value".
        missions: ids to be flown one after the other without asking; empty: the user selects.
        output: folder of the run; empty: a new one under ROS_HOME/amaze_autonomy.
        exit_when_ended: end the process when the last mission has ended.
        unattended: nobody will answer: `unattended.py` does.
        peers_limit_s: how long the missions of `missions` wait for all peers to be started, in any order.
        resume: go on with the journal of a run that did not end.
        nice: niceness of the process, where the system permits it.
    """

    config: Path
    overrides: Tuple[str, ...] = ()
    missions: Tuple[str, ...] = ()
    output: str = ""
    exit_when_ended: bool = False
    unattended: bool = False
    peers_limit_s: float = 15.0
    resume: bool = True
    nice: int = -10


def _words(name: str, value: Any) -> Tuple[str, ...]:
    """Return ids from what YAML makes of `1`, `"1,2"` or `[1, 2]`."""
    if isinstance(value, (list, tuple)):
        return tuple(str(item).strip() for item in value)
    if isinstance(value, (str, int)) and not isinstance(value, bool):
        return tuple(word.strip() for word in str(value).split(",") if word.strip())
    raise StartError(f"~{name} is {value!r}, must be ids of missions, e.g. 1 or '1,2'")


def _flag(name: str, default: bool) -> bool:  # noqa: FBT001 - a parameter of rospy's kind
    value = rospy.get_param(f"~{name}", default)
    if not isinstance(value, bool):
        raise StartError(f"~{name} is {value!r}, must be true or false")
    return value


def _seconds(name: str, default: float) -> float:
    value = rospy.get_param(f"~{name}", default)
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0.0 <= value < float("inf"):
        raise StartError(f"~{name} is {value!r}, must be seconds, not negative")
    return float(value)


def configuration_folder() -> Path:
    """Return the folder that ~config names, or the one that ships with the package."""
    config = str(rospy.get_param("~config", ""))
    return Path(config).expanduser() if config else config_folder()


def overrides() -> Tuple[str, ...]:
    """Return ~overrides, a list or one text with semicolons, with ~require_go among them when it is set."""
    value = rospy.get_param("~overrides", "")
    given = [str(each) for each in value] if isinstance(value, (list, tuple)) else str(value).split(";")
    require_go = str(rospy.get_param("~require_go", "")).lower()
    if require_go:
        given.append(f"autonomy.require_go={require_go}")
    return tuple(each.strip() for each in given if each.strip())


def read_parameters() -> Parameters:
    """Read them from the parameter server.

    Raises:
        StartError: One is not of its kind.
    """
    nice = rospy.get_param("~nice", -10)
    if not isinstance(nice, int) or isinstance(nice, bool):
        raise StartError(f"~nice is {nice!r}, must be a whole number")
    return Parameters(
        config=configuration_folder(),
        overrides=overrides(),
        missions=_words("mission", rospy.get_param("~mission", "")),
        output=str(rospy.get_param("~output", "")),
        exit_when_ended=_flag("exit_when_ended", default=False),
        unattended=_flag("unattended", default=False),
        peers_limit_s=_seconds("peers_limit", 15.0),
        resume=_flag("resume", default=True),
        nice=nice,
    )
