"""The command `amaze-autonomy`: check a configuration, list its missions, write documentation, fly in simulation."""

from __future__ import annotations

import argparse
import json
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Set, Tuple

from . import paths
from .bags.cli import add_memory
from .command_line import run_command, say_wrong
from .files import write_whole
from .paths import expanded

OK, WRONG, USAGE, NOBODY = 0, 1, 2, 3
_RAW = argparse.RawDescriptionHelpFormatter
_FOR = "seconds to listen for (default: 10)"
_LONGEST_S = 86400.0
_REMAP = re.compile(r"(?P<old>[/a-zA-Z][/\w]*):=(?P<new>[/a-zA-Z][/\w]*)", re.ASCII)
_NO_ROS = "there is no ROS here ({}): source its setup.bash"
_DESCRIPTION = "Autonomy engine for multicopters with a PX4 autopilot: the commands that need no ROS."
_STATUSES = """\
exit status:
  0  good
  1  the configuration has a mistake (one line says where, what is wrong and what would be right), or
     the documentation differs from the code
  2  wrong use of the command
simulate has its own: see its --help
"""
_EXAMPLES = """\
examples:
  amaze-autonomy check-config                       the configuration that ships with the package
  amaze-autonomy check-config ~/flight/config       another folder
  amaze-autonomy check-config --set autonomy.require_go=true --json
  amaze-autonomy missions
  amaze-autonomy simulate --help
"""
_CHECK_EXAMPLES = """\
examples:
  amaze-autonomy check-config ~/flight/config
  amaze-autonomy check-config --set sensors.components.gps.severity=highest
  amaze-autonomy check-config --json | python3 -m json.tool
"""
_DOCS_EXAMPLES = """\
examples:
  amaze-autonomy docs            write what is generated into docs/ of the source tree
  amaze-autonomy docs --check    say whether it differs, and where first; write nothing
"""
_MISSIONS_EXAMPLES = """\
examples:
  amaze-autonomy missions
  amaze-autonomy missions ~/flight/config --json
"""
_IMPORT_EXAMPLES = """\
examples:
  amaze-autonomy import-cns ~/cns/config --output ~/flight/config
  amaze-autonomy check-config ~/flight/config
"""
_PROPOSE_EXAMPLES = """\
examples:
  amaze-autonomy propose-config flight.bag --output ~/flight/config
  amaze-autonomy propose-config --live --for 20     of the graph that runs now
  amaze-autonomy check-config ~/flight/config

exit status:
  0  good
  1  nothing can be proposed of it, or what was written has a mistake
  2  wrong use of the command
  3  with --live: there is no ROS master to ask, or no ROS here
"""
_DOCTOR_EXAMPLES = """\
examples:
  amaze-autonomy doctor ~/flight/config
  amaze-autonomy doctor --for 20 --json
  amaze-autonomy doctor ~/flight/config mission_planner/load:=/my_planner/load     as your launch file remaps it
  amaze-autonomy doctor ~/flight/config --platform second     on the computer of that name in recording.yaml
  ROS_NAMESPACE=/amaze amaze-autonomy doctor
  amaze-autonomy doctor ~/flight/config --peers cns
  amaze-autonomy doctor ~/flight/config --cns-served watchdog,data_recorder --cns-namespace /cns

exit status:
  0  nothing is wrong (there may be warnings)
  1  something is wrong, or the configuration has a mistake
  2  wrong use of the command
  3  there is no ROS master to ask, or no ROS here
"""
_OURS = ("~journal", "~state", "~messages", "~state_name", "/diagnostics", "/rosout", "/tf", "/tf_static", "/clock")
_FOLDER = "folder of the configuration (default: the one that ships with the package)"


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Run a command and return its exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] == ["simulate"]:  # has its own options and its own --help
        return _simulate(arguments[1:])
    if arguments[:1] == ["vehicle"]:
        return _vehicle(arguments[1:])
    if arguments[:1] == ["doctor"]:  # a remap stands among the words as it does for a node
        pairs = zip(["", *arguments], arguments)
        arguments = [
            f"--remap={word}" if before != "--remap" and _REMAP.fullmatch(word) else word for before, word in pairs
        ]
    options = _parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], int] = options.command
    return run_command("amaze-autonomy", lambda: command(options), (), wrong=WRONG)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("amaze-autonomy", description=_DESCRIPTION, **_layout(_EXAMPLES))
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    words = "check every file of a configuration and say the first mistake"
    check = commands.add_parser("check-config", help=words, description=words, **_layout(_CHECK_EXAMPLES))
    check.add_argument("folder", nargs="?", type=expanded, metavar="FOLDER", help=_FOLDER)
    _add_common(check)
    check.set_defaults(command=_check_config)

    words = "list the missions of a configuration"
    missions = commands.add_parser("missions", help=words, description=words, **_layout(_MISSIONS_EXAMPLES))
    missions.add_argument("folder", nargs="?", type=expanded, metavar="FOLDER", help=_FOLDER)
    _add_common(missions)
    missions.set_defaults(command=_missions)

    words = "make a configuration of one of the CNS Flight Stack: missions, trajectories, watchdog files"
    cns = commands.add_parser("import-cns", help=words, description=words, **_layout(_IMPORT_EXAMPLES))
    cns.add_argument("folder", type=expanded, metavar="FOLDER", help="with its files, at any depth")
    words = "folder to write, new or empty (default: ./amaze_config)"
    cns.add_argument("--output", type=expanded, default=Path("amaze_config"), metavar="DIR", help=words)
    cns.set_defaults(command=_import_cns)

    _add_doctor(commands)

    words = "write a first configuration of what a recording, or the graph that runs now, shows"
    first = commands.add_parser(
        "propose-config", help=words, description=words, epilog=_PROPOSE_EXAMPLES, formatter_class=_RAW
    )
    first.add_argument("recordings", nargs="*", type=expanded, metavar="BAG", help="of one flight, or at rest")
    first.add_argument("--live", action="store_true", help="listen to every topic of the running graph instead")
    first.add_argument("--for", type=_seconds, default=10.0, dest="for_s", metavar="SECONDS", help=_FOR)
    add_memory(first)
    words = "folder to write, new or empty (default: ./amaze_config)"
    first.add_argument("--output", type=expanded, default=Path("amaze_config"), metavar="DIR", help=words)
    first.set_defaults(command=_propose_config)

    words = "write the generated parts of docs/, or check them"
    docs = commands.add_parser("docs", help=words, description=words, **_layout(_DOCS_EXAMPLES))
    docs.add_argument("--check", action="store_true", help="write nothing; exit status 1 when something differs")
    docs.add_argument(
        "--folder", type=expanded, metavar="DOCS", help="folder of the pages (default: docs/ of the sources)"
    )
    docs.set_defaults(command=_docs)

    commands.add_parser("simulate", help="fly missions in the simulated world, in virtual time", add_help=False)
    commands.add_parser("vehicle", help="a simulated PX4 that speaks MAVLink on UDP, in real time", add_help=False)
    return parser


def _seconds(text: str) -> float:
    """Return a time to listen for."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value <= _LONGEST_S:  # which NaN is not, either
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds above 0 and at most {_LONGEST_S:g}")
    return value


def _remap(text: str) -> Tuple[str, str]:
    """Return the name that was, and the one that is."""
    found = _REMAP.fullmatch(text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no FROM:=TO of two names")
    return found["old"], found["new"]


def _names(text: str) -> Tuple[str, ...]:
    """Return names with commas between."""
    return tuple(name for name in text.replace(" ", "").split(",") if name)


def _layout(examples: str) -> Dict[str, Any]:
    return {"epilog": f"{examples}\n{_STATUSES}", "formatter_class": _RAW}


def _add_doctor(commands: Any) -> None:
    words = "compare a configuration with the graph that runs now, and with this computer"
    doctor = commands.add_parser("doctor", help=words, description=words, epilog=_DOCTOR_EXAMPLES, formatter_class=_RAW)
    doctor.add_argument("folder", nargs="?", type=expanded, metavar="FOLDER", help=_FOLDER)
    doctor.add_argument("--for", type=_seconds, default=10.0, dest="for_s", metavar="SECONDS", help=_FOR)
    words = "which of recording.yaml this computer is (default: the collector)"
    doctor.add_argument("--platform", default="", metavar="NAME", help=words)
    words = "a name that was remapped, as in your launch file, e.g. mission_planner/load:=/my_planner/load; may be "
    words += "repeated; FROM:=TO alone is the same"
    doctor.add_argument("--remap", type=_remap, action="append", default=[], metavar="FROM:=TO", help=words)
    of_cns = doctor.add_argument_group("beside the CNS Flight Stack, as the arguments of autonomy.launch say")
    of_cns.add_argument("--peers", choices=["cns"], help="its nodes are peers of our engine")
    of_cns.add_argument("--cns-peers", type=_names, default=(), metavar="NAMES", help="which of them, with commas")
    of_cns.add_argument("--serve", choices=["cns"], help="our nodes serve its engine")
    of_cns.add_argument("--cns-served", type=_names, default=(), metavar="NAMES", help="which of them, with commas")
    of_cns.add_argument("--cns-namespace", default="", metavar="NAMESPACE", help="that its names are in, e.g. /cns")
    _add_common(doctor)
    doctor.set_defaults(command=_doctor)


def _add_common(parser: argparse.ArgumentParser) -> None:
    words = "override a value, e.g. autonomy.require_go=true; may be repeated"
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help=words)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def _load(options: argparse.Namespace) -> Any:
    """Load the configuration; print the mistake and return None when there is one."""
    from .config import ConfigError, load_configuration  # noqa: PLC0415 (--help stays quick)

    try:
        configuration = load_configuration(options.folder or paths.config_folder(), options.overrides)
        if configuration.autopilot.rates_hz:
            from .autopilot.vehicle.client import asked_rates_hz  # noqa: PLC0415 - it knows the messages

            asked_rates_hz(configuration.autopilot)
    except ConfigError as error:
        if options.json:
            fields = {name: getattr(error, name) for name in ("file", "line", "key", "wrong", "right")}
            _print_json({"valid": False, **fields})
        else:
            print(error, file=sys.stderr)
        return None
    return configuration


def _print_json(value: Mapping[str, Any]) -> None:
    print(json.dumps(value, indent=2, sort_keys=True))


def _check_config(options: argparse.Namespace) -> int:
    configuration = _load(options)
    if configuration is None:
        return WRONG
    warnings = _warnings(configuration)
    if options.json:
        found = {"folder": str(configuration.folder), "hash": configuration.hash, "effective": configuration.effective}
        _print_json({"valid": True, "warnings": warnings, **found})
        return OK
    counts = f"{len(configuration.components)} components, {len(configuration.plans)} missions"
    print(f"{configuration.folder}: good: {counts}, hash {configuration.hash[:12]}")
    _print_warnings(warnings)
    return OK


def _warnings(configuration: Any) -> List[str]:
    """Return what files may say and do not mean together, and topics that nobody would miss."""
    from .config.consistency import (  # noqa: PLC0415
        contradictions,
        taken_in_place,
        unnamed_topics,
        unrecorded_topics,
    )
    from .config.trajectories import low_batteries  # noqa: PLC0415

    effective = configuration.effective
    return [
        *_unusable_keys(configuration.autopilot),
        *contradictions(effective),
        *low_batteries(configuration),
        *taken_in_place(configuration.recording),
        *unrecorded_topics(effective["sensors"], effective["recording"]),
        *unnamed_topics(effective, _named(configuration)),
    ]


def _unusable_keys(autopilot: Any) -> Iterator[str]:
    """Yield a line for each key for signing that a node could not use; on another computer it may be there."""
    for name, link in (("link", autopilot.link), ("planner_link", autopilot.planner_link)):
        if link.key_file and autopilot.backend == "mavlink":
            from .autopilot.errors import AutopilotError  # noqa: PLC0415 - with it comes all that knows messages
            from .autopilot.link.wire import read_key  # noqa: PLC0415

            try:
                read_key(paths.expanded(link.key_file))
            except AutopilotError as error:
                yield f"{name}.key_file of autopilot.yaml: {error}"


def _named(configuration: Any) -> Set[str]:
    """Return the topics that nodes of ours, a CNS Flight Stack, mavros or maps name."""
    from .autopilot.mavros.messages import RECEIVED, SOURCES  # noqa: PLC0415 (--help stays quick)
    from .cns.tables import TOPICS  # noqa: PLC0415
    from .config import ConfigError  # noqa: PLC0415
    from .interface import STATUSES  # noqa: PLC0415
    from .replay.maps.topic_map import load_map, map_names  # noqa: PLC0415

    maps = [load_map(name) for name in map_names()]
    with suppress(ConfigError):
        maps.append(load_map(str(configuration.folder / "map.yaml")))
    topics = {topic for each in maps for topic in each.topics}
    topics.update(f"/{source.topic}" if source is RECEIVED else f"/mavros/{source.topic}" for source in SOURCES)
    at = configuration.autopilot.mavros
    below = {topic.replace("/mavros", at, 1) for topic in topics if topic.startswith("/mavros/")}
    return {*_OURS, *below, *topics, *(each.topic for each in STATUSES), *(each.name for each in TOPICS.values())}


def _print_warnings(warnings: Iterable[str]) -> None:
    for line in warnings:
        print(f"  warning: {line}")


def _missions(options: argparse.Namespace) -> int:
    configuration = _load(options)
    if configuration is None:
        return WRONG
    rows = [_mission_row(plan, configuration.battery.minimum_fraction) for plan in configuration.plans]
    if options.json:
        _print_json({"missions": rows})
        return OK
    width = max(len(row["id"]) for row in rows)
    print(f"{'id':<{width}}  {'duration':>8}  {'length':>7}  {'battery':>7}  description")
    for row in rows:
        duration = f"{row['estimated_duration_s']:.0f} s"
        length, battery = f"{row['length_m']:.0f} m", f"{100 * row['battery_needed_fraction']:.0f} %"
        print(f"{row['id']:<{width}}  {duration:>8}  {length:>7}  {battery:>7}  {row['description']}")
    return OK


def _mission_row(plan: Any, least_battery: float) -> Dict[str, Any]:
    """Return what is said of a mission; its battery is what the check before the takeoff asks for."""
    mission = plan.mission
    return {
        "id": mission.id,
        "description": mission.description,
        "files": [trajectory.file for trajectory in plan.trajectories],
        "repetitions": mission.repetitions,
        "length_m": round(plan.total.length_m, 3),
        "estimated_duration_s": round(mission.estimated_duration_s, 3),
        "battery_needed_fraction": round(max(mission.battery_needed_fraction, least_battery), 4),
    }


def _import_cns(options: argparse.Namespace) -> int:
    """Write and check a configuration, with a report of what became of each line; kept beside it."""
    from .cns.importer import ImportFolderError, import_folder  # noqa: PLC0415 (--help stays quick)
    from .config import ConfigError, load_configuration  # noqa: PLC0415

    try:
        report = import_folder(options.folder, options.output).text()
    except ImportFolderError as error:
        return say_wrong("import-cns", str(error), WRONG)
    write_whole(options.output / "import.txt", report + "\n")
    print(report)
    try:
        configuration = load_configuration(options.output)
    except ConfigError as error:
        return say_wrong("import-cns", f"written, and to be corrected: {error}", WRONG)
    counts = f"{len(configuration.components)} components, {len(configuration.plans)} missions"
    print(f"\n{options.output}: good: {counts}; read what was assumed: {options.output / 'import.txt'}")
    _print_warnings(_warnings(configuration))
    return OK


def _propose_config(options: argparse.Namespace) -> int:
    """Write and check a first configuration, and say what was assumed; kept beside it."""
    if bool(options.recordings) == options.live:
        return say_wrong("propose-config", "name recordings, or say --live", USAGE)
    from .bags.errors import BagError  # noqa: PLC0415 (--help stays quick)
    from .config import ConfigError, load_configuration  # noqa: PLC0415
    from .replay.errors import ReplayError  # noqa: PLC0415
    from .replay.maps.first_configuration import write_configuration  # noqa: PLC0415
    from .replay.maps.proposal import propose, propose_of  # noqa: PLC0415

    try:
        if options.live:
            try:
                from .ros.graph import GraphError, listen  # noqa: PLC0415 (it needs ROS)
            except ImportError as error:
                return say_wrong("propose-config", _NO_ROS.format(error), NOBODY)
            try:
                proposal = propose_of([listen(options.for_s)], [Path("the running graph")])
            except GraphError as error:
                return say_wrong("propose-config", str(error), NOBODY)
        else:
            proposal = propose(options.recordings, options.memory)
            for problem in proposal.problems:
                say_wrong("propose-config", problem, WRONG)
        assumed = write_configuration(proposal, options.output)
    except (BagError, ReplayError) as error:
        return say_wrong("propose-config", str(error), WRONG)
    print("\n".join(assumed))
    try:
        configuration = load_configuration(options.output)
    except ConfigError as error:
        return say_wrong("propose-config", f"written, and to be corrected: {error}", WRONG)
    print(f"\n{options.output}: good: {len(configuration.components)} components; look at {options.output}/propose.txt")
    _print_warnings(_warnings(configuration))
    return OK


def _doctor(options: argparse.Namespace) -> int:
    """Say what is wrong, and which line would put it right."""
    from .cns.tables import PEERS  # noqa: PLC0415 (--help stays quick)
    from .doctor import GOOD, Arrangement, ArrangementError, Way, examine, examine_host, wanted  # noqa: PLC0415
    from .doctor import WRONG as IS_WRONG  # noqa: PLC0415

    peers, served = options.cns_peers or PEERS * bool(options.peers), options.cns_served or PEERS * bool(options.serve)
    try:
        arrangement = Arrangement(peers, served, options.cns_namespace)
    except ArrangementError as error:
        return say_wrong("doctor", str(error), USAGE)
    configuration = _load(options)
    if configuration is None:
        return WRONG
    platforms = [each.name for each in configuration.recording.platforms]
    platform = options.platform or configuration.recording.collector
    if platform not in platforms:
        return say_wrong("doctor", f"--platform: is {platform!r}, recording.yaml has {', '.join(platforms)}", USAGE)
    try:
        from .ros.graph import GraphError, look  # noqa: PLC0415 (it needs ROS)
    except ImportError as error:
        return say_wrong("doctor", _NO_ROS.format(error), NOBODY)
    try:
        services = [row.name for row in wanted(configuration, arrangement) if row.way is Way.OFFERED]
        graph = look(options.for_s, services, dict(options.remap))
    except GraphError as error:
        return say_wrong("doctor", str(error), NOBODY)
    findings = (*examine(configuration, graph, arrangement), *examine_host(configuration, platform))
    if options.json:
        _print_json({"findings": [vars(each) for each in findings]})
    else:
        for each in sorted(findings, key=lambda each: each.level == GOOD):
            print(f"{each.level:<8}{each.about}: {each.said}" + (f"\n        -> {each.line}" if each.line else ""))
    return WRONG if any(each.level == IS_WRONG for each in findings) else OK


def _docs(options: argparse.Namespace) -> int:
    from .documents import (  # noqa: PLC0415 (--help stays quick)
        DocumentError,
        drawn,
        not_shown,
        regenerated,
        shipped_configuration,
    )

    folder = options.folder or Path(__file__).resolve().parents[2] / "docs"
    if not folder.is_dir():
        print(f"{folder}: is not a folder; name the docs of a source tree with --folder", file=sys.stderr)
        return USAGE
    try:
        pages = regenerated(folder)
    except DocumentError as error:
        print(error, file=sys.stderr)
        return WRONG
    if options.folder is None:
        pages = (*pages, shipped_configuration(), *drawn(folder))
    changed = [_changed(*page, check=options.check) for page in pages if page[1] != page[2]]
    missing = not_shown(new for _, _, new in pages)
    if missing:
        print(f"{folder}: no page shows {', '.join(missing)}", file=sys.stderr)
    return WRONG if missing else max(changed, default=OK)


def _changed(page: Path, old: str, new: str, *, check: bool) -> int:
    from .documents import first_difference  # noqa: PLC0415 (as above)

    if not check:
        page.write_text(new, encoding="utf-8")
        print(f"{page}: written")
        return OK
    line, is_there, should_be = first_difference(old, new)
    print(f"{page}:{line}: differs from the code; run `amaze-autonomy docs`", file=sys.stderr)
    print(f"  is        {is_there}\n  should be {should_be}", file=sys.stderr)
    return WRONG


def _simulate(arguments: List[str]) -> int:
    from .simulation.cli import main as simulate  # noqa: PLC0415 (it is large)

    return int(simulate(arguments))


def _vehicle(arguments: List[str]) -> int:
    from .simulation.px4_udp import main as vehicle  # noqa: PLC0415 (it is large)

    return int(vehicle(arguments))
