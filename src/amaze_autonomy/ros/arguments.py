"""What a node is told by the words of its command line alone: what names a path, a command or the configuration.

Who reaches the master may set every parameter, and a node that is started again reads them again: a driver in
~overrides was run as a command. So these are words, `--config FOLDER`, which roslaunch gives the node each time as it
was told itself. A parameter of such a name is not read; one that says something else is named in the log.

The form is neither `name:=value`, which is a remapping to rospy, nor `_name:=value`, which rospy makes a parameter of.
What is no danger in a stranger's hand stays a parameter: `node_main.py` and the nodes name them.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.paths import config_folder, expanded

from .errors import StartError

_REMAPPING = ":="
_START_ERROR = 2


@dataclass(frozen=True)
class Argument:
    """One row.

    Args:
        value: what stands for its value, in words to people.
        about: what it is.
        default: its value where it is not given.
    """

    value: str
    about: str
    default: str = ""


ARGUMENTS: Mapping[str, Argument] = {
    "config": Argument("FOLDER", "of the configuration; empty: the one that ships with the package"),
    "overrides": Argument("FILE.KEY=VALUE; ...", "keys of the configuration that are to be different"),
    "require_go": Argument("true", "READY waits for the operator's go; empty: as the configuration says"),
    "output": Argument("FOLDER", "of the run; empty: a new one in that of the runs"),
    "runs": Argument("FOLDER", "of the runs, simulated ones apart; empty: amaze_autonomy in ROS_HOME"),
    "folder": Argument("FOLDER", "of the recordings; empty: the one of recording.yaml"),
    "transfer": Argument("WAY", "of all others' parts: rsync, shared or here; empty: as recording.yaml says"),
    "recordings": Argument("PLATFORM=[HOST:]FOLDER; ...", "where its recorder writes; empty: as recording.yaml says"),
    "faults": Argument("FILE", "with a scenario; empty: nothing goes wrong"),
    "received": Argument("FILE", "that gets a line of JSON for each request that arrived; empty: none"),
    "vehicle_url": Argument("URL", "where a vehicle that is flown elsewhere is heard", "udpin:127.0.0.1:14550"),
    "bag": Argument("FILE", "the recording"),
    "result": Argument("FILE", "that gets, as JSON, how many messages each listener has received; empty: none"),
    "address": Argument("ADDRESS", "of this computer, that the page is reached at", "127.0.0.1"),
    "port": Argument("PORT", "of the page; 0: any that is free", "8080"),
    "token_file": Argument("FILE", "whose first line allows commands; made if there is none; empty: below ROS_HOME"),
}
"""All words, by their names: no parameter of ours is called so."""

_CONFIGURATION = ("config", "overrides")
NODES: Mapping[str, Tuple[str, ...]] = {
    "autonomy": (*_CONFIGURATION, "require_go", "output", "runs"),
    "watchdog": _CONFIGURATION,
    "landing_detection": _CONFIGURATION,
    "state_estimation": _CONFIGURATION,
    "autopilot": _CONFIGURATION,
    "mission_planner": _CONFIGURATION,
    "data_recorder": (*_CONFIGURATION, "folder", "transfer"),
    "cns_peers": (*_CONFIGURATION, "recordings"),
    "cns_server": _CONFIGURATION,
    "simulation": (*_CONFIGURATION, "faults", "received", "vehicle_url"),
    "recorded_peers": ("bag", "result"),
    "mavlink_router": _CONFIGURATION,
    "web": (*_CONFIGURATION, "address", "port", "token_file"),
}
"""Which words each node takes."""


def option(name: str) -> str:
    """Return how a word is given: --token-file."""
    return f"--{name.replace('_', '-')}"


_OPTIONS: Mapping[str, str] = {option(name): name for name in ARGUMENTS}


def given(name: str, words: Optional[Sequence[str]] = None) -> str:
    """Return the value of a word, of the process's command line unless another one is named; else its default.

    An empty value is the default: nobody means the address of all networks by giving none.

    Raises:
        StartError: The command line is wrong.
    """
    named, _ = split_words(sys.argv[1:] if words is None else words)
    return named.get(name) or ARGUMENTS[name].default


def answer_words(name: str, *about: Optional[str], places: Sequence[str] = ()) -> Optional[int]:
    """Answer who asks for help on the command line, or say which word the node does not take; return the exit status.

    A node that started all the same would end the one of its name that runs: that is how ROS has it.

    Args:
        name: of the node, a key of `NODES`.
        about: what it is, and its parameters.
        places: names of what stands there without a name, in order.

    Returns:
        None: the words are right, and the node may start.
    """
    if {"-h", "--help"}.intersection(sys.argv[1:]):
        usage = " ".join([f"usage: rosrun amaze_autonomy {name}", *map(str.upper, places), "[--WORD VALUE ...]"])
        rows = f"Words:\n{help_rows(name)}"
        print("\n\n".join([f"{usage} [_PARAMETER:=VALUE ...]", *(each.strip() for each in about if each), rows]))
        return 0
    try:
        read_words(name, sys.argv[1:], *places)
    except StartError as error:
        print(f"{name}: {error}", file=sys.stderr, flush=True)
        return _START_ERROR
    return None


def configuration_folder() -> Path:
    """Return the folder that --config names, or the one that ships with the package."""
    config = given("config")
    return expanded(config) if config else config_folder()


def overrides() -> Tuple[str, ...]:
    """Return --overrides, a text with semicolons, with --require-go among them when it is given."""
    words = given("overrides").split(";")
    if given("require_go"):
        words.append(f"autonomy.require_go={given('require_go').lower()}")
    return tuple(each.strip() for each in words if each.strip())


def read_words(node: str, words: Sequence[str], *places: str) -> Dict[str, str]:
    """Return the values of all words that a node takes.

    Args:
        node: a key of `NODES`.
        words: of the command line, remappings and parameters among them.
        places: names of what stands there without a name, in order.

    Raises:
        StartError: A word is not taken, has no value, or would be a parameter.
    """
    named, others = split_words(words)
    wrong = [option(name) for name in named if name not in NODES[node]] + others[len(places) :]
    if wrong:
        raise StartError(f"it takes no {wrong[0]!r}; --help has more")
    if len(others) < len(places):
        raise StartError(f"{places[len(others)].upper()} is missing; --help has more")
    return {**{name: ARGUMENTS[name].default for name in NODES[node]}, **named, **dict(zip(places, others))}


def split_words(words: Sequence[str]) -> Tuple[Dict[str, str], List[str]]:
    """Return the words of the table by their names, and what else there is besides remappings and parameters.

    Raises:
        StartError: A word has no value, or would be a parameter.
    """
    named: Dict[str, str] = {}
    others: List[str] = []
    left = iter(words)
    for word in left:
        key, mark, value = word.partition("=")
        if key in _OPTIONS:
            value = value if mark else next(left, _REMAPPING)
            if not mark and _REMAPPING in value:
                raise StartError(f"{key} has no value; --help has more")
            named[_OPTIONS[key]] = value
        elif _REMAPPING not in word:
            others.append(word)
        else:
            _refuse_parameter(word)
    return named, others


def _refuse_parameter(word: str) -> None:
    """Refuse what rospy would make a parameter of that nobody reads."""
    key, _, value = word.partition(_REMAPPING)
    if key.startswith("_") and key[1:] in ARGUMENTS:
        right = f"{option(key[1:])} {value}"
        raise StartError(f"{word} makes a parameter of it, which anybody may set: write {right}")


def help_rows(node: str) -> str:
    """Return what a node takes, a line for each word."""
    rows = [(f"{option(name)} {ARGUMENTS[name].value}", name) for name in NODES[node]]
    width = max(len(words) for words, _ in rows)
    return "\n".join(f"{words:<{width}}  {_about(ARGUMENTS[name])}" for words, name in rows)


def _about(argument: Argument) -> str:
    return f"{argument.about} (default: {argument.default})" if argument.default else argument.about


def parameter_words(name: str) -> str:
    """Return what to write in a launch file in the place of a parameter."""
    words = f"{option(name)} '{ARGUMENTS[name].value}'"
    return f'write <node ... args="{words}"/> in the place of <param name="{name}"/>'
