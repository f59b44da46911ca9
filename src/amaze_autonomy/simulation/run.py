"""The command `amaze-autonomy simulate`: fly missions in the simulated world, in virtual time, and tell the story."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

from amaze_autonomy import paths
from amaze_autonomy.config import ConfigError, load_configuration
from amaze_autonomy.engine.commands import Command, Decision, Notify, Request, Value
from amaze_autonomy.engine.mission import Mission
from amaze_autonomy.engine.state import Result

from .errors import SimulationError
from .loop import Run, run
from .scenario import EVENTS, KINDS, Scenario
from .scenario_file import load_scenario

__all__ = ["COMPLETE", "LIMIT", "NOT_COMPLETE", "USAGE", "WAITING", "Run", "main", "run"]

_NS = 1e9
COMPLETE, NOT_COMPLETE, USAGE, WAITING, LIMIT = 0, 1, 2, 3, 4
_DESCRIPTION = "Fly missions in the simulated world, in virtual time: no ROS, no waiting, the same every time."
_EPILOG = """\
examples:
  amaze-autonomy simulate
  amaze-autonomy simulate --mission 2,3
  amaze-autonomy simulate --faults lrf                       a scenario that ships with the package
  amaze-autonomy simulate --faults my.yaml --journal out.jsonl
  amaze-autonomy simulate --list                             scenarios, kinds of faults, events to wait for

exit status:
  0  every mission ended COMPLETE
  1  a mission ended otherwise
  2  wrong use, or a mistake in the configuration or the scenario (one line says where)
  3  the engine waits for a person who, by the scenario, does not come
  4  the limit of simulated time was reached
"""


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Run the command and return its exit status."""
    options = _parser().parse_args(argv)
    folder = options.config or paths.config_folder()
    if options.list:
        print("\n".join(_listing(folder)))
        return COMPLETE
    try:
        configuration = load_configuration(folder, options.overrides)
        missions = tuple(_mission(configuration.missions, name) for name in options.mission.split(","))
        scenario = load_scenario(_scenario_file(folder, options.faults)) if options.faults else Scenario()
        result = run(configuration, missions, scenario, seed=options.seed, limit_ns=round(options.limit_s * _NS))
    except (ConfigError, SimulationError, ValueError) as error:
        print(f"simulate: {error}", file=sys.stderr)
        return USAGE
    if options.journal:
        try:
            options.journal.write_text("".join(line + "\n" for line in result.lines), encoding="ascii")
        except OSError as error:
            print(f"simulate: {options.journal}: cannot be written ({error.strerror})", file=sys.stderr)
            return USAGE
    print(json.dumps(_summary(result), indent=2, sort_keys=True) if options.json else _story(scenario, result))
    return _status(result)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "amaze-autonomy simulate",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    words = "mission to fly, or several with commas between (default: 1)"
    parser.add_argument("--mission", default="1", metavar="ID", help=words)
    words = "scenario: a file, or the name of one in the configuration's folder faults/"
    parser.add_argument("--faults", default="", metavar="FILE", help=words)
    parser.add_argument("--seed", type=int, default=0, help="of noise and latencies (default: 0)")
    words = "folder of the configuration (default: the one that ships with the package)"
    parser.add_argument("--config", type=Path, metavar="DIR", help=words)
    words = "override a value, e.g. autonomy.require_go=true; may be repeated"
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help=words)
    parser.add_argument("--journal", type=Path, metavar="FILE", help="write the journal (JSON Lines)")
    words = "simulated seconds after which it ends (default: 7200)"
    parser.add_argument("--limit", type=float, default=7200.0, dest="limit_s", metavar="S", help=words)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--list", action="store_true", help="list scenarios, kinds of faults and events, and end")
    return parser


def _mission(missions: Tuple[Mission, ...], name: str) -> Mission:
    for mission in missions:
        if mission.id == name.strip():
            return mission
    raise ValueError(f"there is no mission {name.strip()!r}; there is {', '.join(each.id for each in missions)}")


def _scenario_file(folder: Path, name: str) -> Path:
    """Return the file that is meant: a path, or a name of a shipped scenario."""
    shipped = folder / "faults" / f"{name}.yaml"
    return shipped if not Path(name).exists() and shipped.is_file() else Path(name)


def _listing(folder: Path) -> List[str]:
    """Return what a scenario can say."""
    files = sorted((folder / "faults").glob("*.yaml"))
    lines = [f"Scenarios in {folder / 'faults'}:"]
    lines += [f"  {file.stem:<28} {load_scenario(file).description}" for file in files]
    lines.append("\nKinds of faults:")
    for (subject, name), kind in KINDS.items():
        parameters = ", ".join(parameter.name for parameter in kind.parameters)
        lines.append(f"  {subject or '-':<10} {name:<24} {kind.words}" + (f" ({parameters})" if parameters else ""))
    lines.append("\nEvents that `after` can wait for:")
    lines += [f"  {name:<12} {words}" for name, words in EVENTS.items()]
    return lines


def _status(result: Run) -> int:
    if not result.finished:
        return LIMIT
    if not result.results:
        return WAITING
    if result.state.state.value != "MISSION_ENDED":
        return WAITING
    return COMPLETE if all(each is Result.COMPLETE for _, each in result.results) else NOT_COMPLETE


# --- what is printed --------------------------------------------------------------------------------------------------


def _story(scenario: Scenario, result: Run) -> str:
    """Return the story of a run: decisions, messages to the user, and what the scenario did, in order of time."""
    told: List[Tuple[int, int, str]] = [(t_ns, 0, f"* {text}") for t_ns, text in result.history]
    told += [(decision.t_ns, 1, text) for decision, text in _joined(result.decisions)]
    told += _messages(result.commands)
    lines = [f"scenario: {scenario.description}", ""]
    lines += [f"{t_ns / _NS:10.3f}  {text}" for t_ns, _, text in sorted(told, key=lambda line: line[:2])]
    lines += ["", *(f"mission {name}: {each.value}" for name, each in result.results)]
    if _status(result) == WAITING:
        lines.append(f"{result.state.state.value}: waits for a person")
    elif _status(result) == LIMIT:
        lines.append(f"{result.state.state.value}: not finished within the limit of simulated time")
    return "\n".join(lines)


def _joined(decisions: Sequence[Decision]) -> List[Tuple[Decision, str]]:
    """Return each decision with its text; the same rule over and over within a state is told once."""
    told: List[Tuple[Decision, str]] = []
    times = 0
    for number, decision in enumerate(decisions):
        following = decisions[number + 1] if number + 1 < len(decisions) else None
        last = decisions[number - 1] if number else None
        if last is None or not _same(last, decision):
            told.append((decision, _decision(decision)))
            times = 0
            continue
        times += 1
        if following is None or not _same(decision, following):
            told.append((decision, f"  ... {decision.rule}, {times} more times until here"))
    return told


def _same(one: Decision, other: Decision) -> bool:
    return one.rule == other.rule and (one.before, one.after) == (other.before, other.after) == (one.after, one.before)


def _decision(decision: Decision) -> str:
    after = f"{decision.after}/{decision.step}" if decision.step else decision.after
    moved = after if decision.before == decision.after else f"{decision.before} -> {after}"
    values = "; ".join(_value(value) for value in decision.values)
    commands = f"  => {', '.join(decision.commands)}" if decision.commands else ""
    return f"{moved}  by {decision.rule}" + (f" ({values})" if values else "") + commands


def _value(value: Value) -> str:
    said = f"{value.value:.6g}" if isinstance(value.value, float) else str(value.value)
    text = " ".join(part for part in (value.name, said, value.unit) if part)
    return text if value.limit is None else f"{text}, limit {value.limit}"


def _messages(commands: Sequence[Tuple[int, Command]]) -> List[Tuple[int, int, str]]:
    """Return the messages to the user; one that is said again and again is told once."""
    told: List[Tuple[int, int, str]] = []
    for t_ns, each in commands:
        if isinstance(each, Notify):
            text = f"  {each.level.name}: {each.text}" + (f" {each.advice}" if each.advice else "")
            if not told or told[-1][2] != text:
                told.append((t_ns, 2, text))
    return told


def _summary(result: Run) -> Dict[str, Any]:
    return {
        "commands": [
            {"command": type(each).__name__, "t_s": t_ns / _NS, **_action(each)}
            for t_ns, each in result.commands
            if isinstance(each, Request)
        ],
        "decisions": [
            {
                "after": decision.after,
                "before": decision.before,
                "commands": list(decision.commands),
                "rule": decision.rule,
                "step": decision.step,
                "t_s": decision.t_ns / _NS,
            }
            for decision in result.decisions
        ],
        "exit_status": _status(result),
        "finished": result.finished,
        "results": [{"mission": name, "result": each.value} for name, each in result.results],
        "simulated_s": result.state.t_ns / _NS,
        "state": result.state.state.value,
        "world": [{"t_s": t_ns / _NS, "text": text} for t_ns, text in result.history],
    }


def _action(request: Request) -> Dict[str, str]:
    """Return which of its kind a request is."""
    for name in ("action", "check"):
        if hasattr(request, name):
            return {name: getattr(request, name).name}
    return {}
