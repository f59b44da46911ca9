"""The command `amaze-autonomy simulate`: fly missions in the simulated world, in virtual time, and tell the story."""

from __future__ import annotations

import argparse
import difflib
import json
from pathlib import Path
from typing import List, Optional, Sequence, Tuple

from amaze_autonomy import paths
from amaze_autonomy.command_line import run_command
from amaze_autonomy.config import ConfigError, load_configuration
from amaze_autonomy.engine.state import DataResult, Result, State
from amaze_autonomy.files import Kind, OutputError, check_output, journal_of, write_whole

from ..engine.events import Mission
from ..paths import expanded
from .errors import SimulationError
from .run import Run, run, story, summary
from .scenario import EVENTS, KINDS, Scenario
from .scenario_file import load_scenario

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
  0  every mission ended COMPLETE, and its data is complete
  1  a mission ended otherwise
  2  wrong use, or a mistake in the configuration or the scenario (one line says where)
  3  the engine waits for a person who, by the scenario, does not come
  4  the limit of simulated time was reached
"""


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Run the command and return its exit status."""
    options = _parser().parse_args(argv)
    known = (ConfigError, SimulationError, OutputError, ValueError)
    return run_command("simulate", lambda: _run(options), known, wrong=USAGE)


def _run(options: argparse.Namespace) -> int:
    folder = options.config or paths.config_folder()
    if options.list:
        print("\n".join(_listing(folder)))
        return COMPLETE
    scenarios = [scenario_file(folder, options.faults)] if options.faults else []
    check_output(options.journal, "--journal", _JOURNAL, scenarios)
    configuration = load_configuration(folder, options.overrides)
    missions = tuple(_mission(configuration.missions, name) for name in options.mission.split(","))
    scenario = load_scenario(scenarios[0]) if scenarios else Scenario()
    result = run(configuration, missions, scenario, seed=options.seed, limit_ns=round(options.limit_s * _NS))
    if options.journal:
        write_whole(options.journal, "".join(line + "\n" for line in result.lines))
    told = {**summary(result), "exit_status": _status(result)}
    print(json.dumps(told, indent=2, sort_keys=True) if options.json else story(scenario, result))
    return _status(result)


_JOURNAL = Kind("journal of a simulation", journal_of("writer", "simulate"))


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
    parser.add_argument("--config", type=expanded, metavar="DIR", help=words)
    words = "override a value, e.g. autonomy.require_go=true; may be repeated"
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help=words)
    parser.add_argument("--journal", type=expanded, metavar="FILE", help="write the journal (JSON Lines)")
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


def scenario_file(folder: Path, name: str) -> Path:
    """Return the file that is meant: a path, or a name of a shipped scenario."""
    if Path(name).exists() or "/" in name or name.endswith(".yaml"):
        return expanded(name)
    shipped = {file.stem: file for file in sorted((folder / "faults").glob("*.yaml"))}
    if not shipped:
        raise ValueError(f"there is no scenario {name!r}: {folder / 'faults'} has none at all; name a file")
    if name not in shipped:
        close = difflib.get_close_matches(name, list(shipped), n=1)
        meant = f"; did you mean {close[0]}?" if close else ""
        there = ", ".join(shipped)
        raise ValueError(f"there is no scenario {name!r} (a component's name alone is none); there is {there}{meant}")
    return shipped[name]


def _listing(folder: Path) -> List[str]:
    """Return what a scenario can say."""
    files = sorted((folder / "faults").glob("*.yaml"))
    lines = [f"Scenarios in {folder / 'faults'}:"]
    lines += [f"  {file.stem:<30} {load_scenario(file).description}" for file in files]
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
    if result.state.state is not State.MISSION_ENDED or not result.results:
        return WAITING
    whole = all(each is Result.COMPLETE and data is not DataResult.INCOMPLETE for _, each, data in result.results)
    return COMPLETE if whole else NOT_COMPLETE
