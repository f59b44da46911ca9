"""`amaze-replay`: recorded bags and journals through the decision code, on any machine.

Exit status: 0 replayed, no difference; 1 a journal is decided differently or breaks a law, or a scenario fails; 2 it
cannot be replayed, one line says why; 3 replayed, but a part of the recording or of the journal is damaged, or a
scenario is inconclusive; 4 nothing was tested: a changed key was not looked at, a scenario is vacuous; 70 an error in
this program.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Tuple

from amaze_autonomy.bags import BagError
from amaze_autonomy.bags.cli import add_memory
from amaze_autonomy.bags.errors import MessageError
from amaze_autonomy.bags.other_formats import content_files
from amaze_autonomy.command_line import outlasting_readers, run_command
from amaze_autonomy.config import ConfigError
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.config.model import Configuration
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.files import Kind, OutputError, check_output, journal_of, write_whole
from amaze_autonomy.paths import config_folder
from amaze_autonomy.replay.compare import Comparison, Lawful, check_laws, compare, law_lines, laws_result

from ..journal.journal import Journal, JournalError
from ..pages.document import PageError, is_document, need_plots
from ..paths import expanded
from ..replay.beginning import ARMING_LEAD_NS, flights_of, part_of
from ..replay.changed_keys import Change, DecidedKeys, Unread, changes_of, keys_of, unread_in_journal
from ..replay.errors import ReplayError
from ..replay.faults.stream import FaultedRecordings
from ..replay.maps.topic_map import TopicMap, load_map, map_names
from ..replay.plan import Plan, make_plan
from ..replay.recordings.journals import read_journals
from ..replay.recordings.sources import RECORDINGS, Recordings, check_messages, topics_of
from ..replay.report import comparison_lines, comparison_result, footer_lines, replay_result, timeline_text, verdict
from ..replay.session import Outcome, Session, mission_of
from .terminal import add_tapes, progress_bar, show_lines, show_timeline, use_tapes

_ALONE = (["run"], ["journal"], ["laws"], ["map"], ["maps"], ["export"])
DONE, DIFFERENT, IMPOSSIBLE, PARTIAL, VACUOUS = 0, 1, 2, 3, 4
_KNOWN = (BagError, MessageError, ReplayError, ConfigError, JournalError, OutputError, PageError)


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command line; return the exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = _parser(scenarios=given[:1] not in _ALONE).parse_args(given)

    def judged() -> int:
        with outlasting_readers():  # `| head` must not turn a failure into a success, or leave its files unwritten
            return int(options.command(options))

    return run_command("amaze-replay", judged, _KNOWN, wrong=IMPOSSIBLE)


def _parser(*, scenarios: bool) -> argparse.ArgumentParser:
    """Return the command line; the verbs about scenarios are loaded only where one of them may be meant."""
    parser = argparse.ArgumentParser(
        prog="amaze-replay",
        description="Replays recorded bags and journals through the decision code of the flight, without ROS.",
        epilog="Exit status: 0 replayed, no difference; 1 a journal is decided differently or breaks a law, or a "
        "scenario fails; 2 it cannot be replayed; 3 a part is damaged or a scenario is inconclusive; 4 a changed key "
        "was not looked at, or a scenario is vacuous; 70 an error in this program.",
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    _add_run(commands)
    _add_journal(commands)
    _add_laws(commands)
    if scenarios:
        from .cli import add_commands  # noqa: PLC0415
        from .corpus import add_corpus  # noqa: PLC0415

        add_commands(commands)
        add_corpus(commands)
    _add_map(commands)
    _add_export(commands)
    maps = commands.add_parser("maps", help="list the topic maps that ship with the package")
    maps.set_defaults(command=_maps)
    return parser


def _add_run(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    run = commands.add_parser("run", help="replay the sensors of one or several recordings of one flight")
    run.add_argument("bags", nargs="+", type=expanded, metavar="FILE", help=f"each {RECORDINGS}")
    run.add_argument("--map", metavar="MAP", help="topic map: name or YAML file; default: the one named as the bag")
    run.add_argument("--mission", metavar="ID", help="mission of the configuration; default: as flown, else its first")
    run.add_argument("--flight", type=int, metavar="N", help="judge the N-th arming by itself, from 1")
    run.add_argument("--flights", action="store_true", help="judge every arming by itself, a line for each")
    run.add_argument("--from", type=_seconds, dest="from_s", metavar="S", help="begin there, from the first message")
    run.add_argument("--to", type=_seconds, dest="to_s", metavar="S", help="end there")
    run.add_argument("--mute", action="append", default=[], metavar="TOPIC", help="leave a topic out; repeatable")
    _add_configuration(run, "default: the one that ships with the package")
    add_tapes(run)
    words = "folder for journal.jsonl, timeline.txt, result.json, and flight.html where plotly is installed"
    run.add_argument("--out", type=expanded, metavar="DIR", help=words)
    add_memory(run)
    _add_page(run)
    run.add_argument("--no-html", action="store_true", help="leave flight.html out of the folder of --out")
    run.add_argument("--json", action="store_true", help="print result.json instead of the timeline")
    run.set_defaults(command=_run)


def _seconds(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is no time within a recording")
    return value


def _add_map(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    proposed = commands.add_parser("map", help="propose a topic map for recordings that nobody described yet")
    proposed.add_argument("bags", nargs="+", type=expanded, metavar="FILE", help=f"of one flight, each {RECORDINGS}")
    proposed.add_argument("--out", type=expanded, metavar="FILE", help="write it there; default: print it")
    add_memory(proposed)
    proposed.set_defaults(command=_propose)


def _add_export(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    words = "write recordings for other programs: MCAP, tables in CSV, the track as KML"
    exported = commands.add_parser("export", help=words)
    exported.add_argument("bags", nargs="+", type=expanded, metavar="FILE", help=f"of one flight, each {RECORDINGS}")
    words = "x.mcap, x.kml, or a folder: there a table x.csv for each topic"
    exported.add_argument("-o", "--output", type=expanded, required=True, metavar="OUT", help=words)
    words = "topics that are wanted, as '/camera/*'; default: all"
    exported.add_argument("--topics", nargs="+", default=(), metavar="PATTERN", help=words)
    exported.add_argument("--force", action="store_true", help="replace an existing output; recordings never are")
    add_memory(exported)
    exported.set_defaults(command=_export)


def _add_journal(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    journal = commands.add_parser("journal", help="decide every event of a flight's journal again, and compare")
    journal.add_argument("file", type=expanded, metavar="FILE", help="journal.jsonl, or a bag with the topic ~journal")
    journal.add_argument("--topic", default="", help="of the journal in a bag; default: the only one there is")
    _add_configuration(journal, "decide with its rules; default: those in the journal's header")
    add_memory(journal)
    journal.add_argument("--json", action="store_true", help="print the result as JSON")
    _add_page(journal)
    journal.set_defaults(command=_journal)


def _add_laws(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    laws = commands.add_parser("laws", help="check the safety laws at every event of a flight's journal")
    laws.add_argument("file", type=expanded, metavar="FILE", help="journal.jsonl, or a bag with the topic ~journal")
    laws.add_argument("--topic", default="", help="of the journal in a bag; default: the only one there is")
    _add_configuration(laws, "decide with its rules; default: those in the journal's header")
    add_memory(laws)
    laws.add_argument("--json", action="store_true", help="print the result as JSON")
    laws.set_defaults(command=_laws)


def _add_page(parser: argparse.ArgumentParser) -> None:
    words = "write the flight page: one file that a browser opens without a network (needs plotly)"
    parser.add_argument("--html", type=expanded, metavar="FILE", help=words)


def _add_configuration(parser: argparse.ArgumentParser, words: str) -> None:
    parser.add_argument("--config", type=expanded, metavar="DIR", help=f"folder of the configuration; {words}")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="FILE.KEY=VALUE",
        help="replace a value of the configuration; repeatable",
    )


def _maps(_: argparse.Namespace) -> int:
    show_lines([f"{name:<28} {load_map(name).about}" for name in map_names()])
    return DONE


def _propose(options: argparse.Namespace) -> int:
    from ..replay.maps.proposal import propose  # noqa: PLC0415

    check_output(options.out, "--out", _ANYTHING, (file for bag in options.bags for file in (bag, *content_files(bag))))
    proposal = propose(options.bags, options.memory)
    if options.out is None:
        show_lines(proposal.text.splitlines())
    else:
        _check_map(options.out, proposal.text)
        write_whole(options.out, proposal.text)
        scripted = f"scripted: {', '.join(proposal.scripted) or 'nothing'}"
        show_lines([*proposal.found, scripted, f"written: {options.out}"])
    return PARTIAL if proposal.problems else DONE


_ANYTHING = Kind("file", lambda _: True)


def _check_map(path: Path, text: str) -> None:
    """Refuse to replace whatever is not this very proposal: a map may have been edited, and is small enough to read.

    Raises:
        OutputError: it is something else.
    """
    if path.is_file() and path.stat().st_size > 0 and path.read_bytes() != text.encode():
        words = "differs from this proposal, and would be replaced"
        raise OutputError(f"{path}: {words}; name another file with --out, or delete that one")


def _export(options: argparse.Namespace) -> int:
    from ..replay.recordings.export import export  # noqa: PLC0415

    done = export(options.bags, options.output, options.topics, options.memory, replace=options.force)
    unread = [f"{topic}: {count:,} messages cannot be read, they are missing" for topic, count in done.unread.items()]
    written = [f"written: {path}" for path in done.files]
    show_lines([*done.problems, *done.left_out, *unread, *written, f"{done.messages:,} messages"])
    return PARTIAL if unread or done.problems else DONE


def _run(options: argparse.Namespace) -> int:
    began = time.monotonic()
    _check_part(options)
    if options.html is not None:
        need_plots()
    use_tapes(options)
    gc.disable()  # a recording is very many values without cycles: looking for those takes a tenth of the time
    recorded = topics_of(options.bags, options.memory)  # a wrong file is said before a missing map
    _check_outputs(options)
    topic_map = _map(options.map, options.bags, options.memory)
    configuration = load_configuration(options.config or config_folder(), options.set)
    plan = make_plan(configuration, topic_map, options.mission or configuration.missions[0].id, recorded)
    before, given = _followed(options)
    with Recordings(options.bags, plan.topics, options.mute, options.memory, replayed=True) as recordings:
        mission_id = mission_of(plan, recordings, configuration.missions, options.mission)
        plan = make_plan(configuration, topic_map, mission_id, recorded)
        changes = changes_of(
            given,
            lambda some: load_configuration(before, some),
            lambda each: make_plan(each, topic_map, mission_id, recorded),
        )
        if options.flights:
            return _each_flight(plan, recordings, changes)
        plan, part = _part(options, plan, recordings)
        with progress_bar("replaying") as progress:
            outcome = Session(plan, part, changes=changes).run(progress)
        _write(options.out, plan, part, outcome)
        _write_page(options, configuration, plan, part, outcome)
        if options.json:
            show_lines([json.dumps(replay_result(plan, part, outcome), indent=1)])
        else:
            show_timeline(outcome)
            show_lines(footer_lines(plan, part, outcome))
    _say_speed(outcome, time.monotonic() - began)
    return PARTIAL if _is_partial(part) else VACUOUS if outcome.unread else DONE


def _is_partial(recordings: Recordings) -> bool:
    return bool(recordings.damage or recordings.problems)


def _check_part(options: argparse.Namespace) -> None:
    """Refuse options that say two things about the part that is judged, or that --flights would not follow."""
    of_part = [name for name in ("from", "to") if getattr(options, f"{name}_s") is not None]
    of_one = [*of_part, *(name for name in ("flight", "out", "html") if getattr(options, name) is not None)]
    given, unfit = "flight", of_part if options.flight is not None else []
    if options.flights:
        given, unfit = "flights", [*of_one, *(["json"] if options.json else [])]
    if unfit:
        words = "judge one with --flight N for that" if given == "flights" else "name either"
        raise ReplayError(f"--{given} goes without --{', --'.join(unfit)}; {words}")


def _part(options: argparse.Namespace, plan: Plan, recordings: Recordings) -> Tuple[Plan, Recordings]:
    """Return the part of a recording that was asked for, and the plan for it."""
    if options.flight is None and options.from_s is None and options.to_s is None:
        return plan, recordings
    if options.flight is not None:
        bounds = part_of(flights_of(plan, recordings), options.flight, recordings)
        return _by_arming(plan), FaultedRecordings(recordings, *bounds)
    end_ns = None if options.to_s is None else round(options.to_s * 1e9)
    part = FaultedRecordings(recordings, round((options.from_s or 0.0) * 1e9), end_ns)
    if not part.samples:
        raise ReplayError("there is no message between --from and --to")
    return plan, part


def _by_arming(plan: Plan) -> Plan:
    """Return a plan that selects the mission in time before the arming of its part, which has times of its own."""
    script = plan.topic_map.script
    before_ns = script.before_arming_ns or ARMING_LEAD_NS
    script = replace(script, select_at_ns=None, before_arming_ns=before_ns)
    return replace(plan, topic_map=replace(plan.topic_map, script=script))


def _each_flight(plan: Plan, recordings: Recordings, changes: Sequence[Change]) -> int:
    """Judge each flight by itself, and print a line for each; return the exit status."""
    problems, lines, vacuous = list(recordings.problems), [], False
    flights = flights_of(plan, recordings)
    for number, flight in enumerate(flights, 1):
        part = FaultedRecordings(recordings, *part_of(flights, number, recordings))
        outcome = Session(_by_arming(plan), part, changes=changes).run()
        lines.append(f"flight {number}, armed {flight.words(recordings.start_ns)}: {verdict(outcome)}")
        lines += [f"  VACUOUS: {each}" for each in outcome.unread]
        vacuous = vacuous or bool(outcome.unread)
        problems += [f"flight {number}: {each}" for each in part.problems if each not in recordings.problems]
    if not flights:
        words, vacuous = "the recording tells of no arming", bool(changes)
        lines = [words, *(f"VACUOUS: {Unread(each.key, words)}" for each in changes)]
    show_lines([*problems, *lines])
    return PARTIAL if problems or recordings.damage else VACUOUS if vacuous else DONE


def _map(name: Optional[str], bags: List[Path], memory: int) -> TopicMap:
    """Return the map that was asked for, or the one named as the first bag that has one."""
    stems = [bag.stem for bag in bags if bag.stem in map_names()]
    if name is None and not stems and all(bag.suffix == ".tlog" for bag in bags):
        return load_map("px4_telemetry")
    if name is None and not stems:
        check_messages(bags, memory)  # of a recording without one no map can be proposed
        raise ReplayError(
            f"which topics are what? Name a topic map with --map: a file that `amaze-replay map` proposes, or "
            f"{', '.join(map_names())}"
        )
    return load_map(name if name is not None else stems[0])


def _check_outputs(options: argparse.Namespace) -> None:
    """Refuse to replace what a replay did not write: a flight's journal and its page are nowhere else.

    Raises:
        ReplayError: the folder is that of a recording.
        OutputError: one of the outputs would take the place of it, or cannot be written.
    """
    out: Optional[Path] = options.out
    if out is not None:
        if out.exists() and not out.is_dir():
            raise OutputError(f"{out}: is no folder; name a folder with --out")
        for bag in options.bags:
            if _holds(out, bag):
                words = f"{out}: holds the recording {bag}, and a journal and a page may be its own"
                raise ReplayError(f"{words}; name another folder with --out")
        journal, page = out / "journal.jsonl", out / "flight.html"
        ours = journal.exists() and _is_journal_of_replay(journal)
        others = [journal] if journal.exists() and not ours else []  # an empty one, too
        if not options.no_html and _is_filled(page) and not _is_page_of_replay(page):
            others.append(page)
        if not ours:  # a replay writes its journal first, so that they are another program's
            others += [out / name for name in ("result.json", "timeline.txt") if _is_filled(out / name)]
        for path in others:
            raise OutputError(f"{path}: is not of a replay, and would be replaced; name another folder with --out")
    check_output(options.html, "--html", _PAGE, options.bags)


def _is_filled(path: Path) -> bool:
    """Tell whether there is anything to lose in a place."""
    return path.exists() and (not path.is_file() or path.stat().st_size > 0)


def _holds(folder: Path, bag: Path) -> bool:
    """Tell whether a recording lies in a folder; a recording that is a folder itself holds only its own files."""
    place = folder.resolve()
    own = bag.is_dir() and bag.resolve() in (place, *place.parents)
    return own or place in (bag.parent.resolve(), bag.resolve().parent)


_is_journal_of_replay = journal_of("program", "amaze-replay")


def _is_page_of_replay(path: Path) -> bool:
    return is_document(path, "Replay of ")


_PAGE = Kind("page of a replay", _is_page_of_replay)


def _write(folder: Optional[Path], plan: Plan, recordings: Recordings, outcome: Outcome) -> None:
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    footer = "".join(f"{line}\n" for line in footer_lines(plan, recordings, outcome))
    write_whole(folder / "journal.jsonl", "".join(f"{line}\n" for line in outcome.journal))
    write_whole(folder / "timeline.txt", timeline_text(outcome) + footer)
    write_whole(folder / "result.json", json.dumps(replay_result(plan, recordings, outcome), indent=1) + "\n")


def _write_page(
    options: argparse.Namespace, configuration: Configuration, plan: Plan, recordings: Recordings, outcome: Outcome
) -> None:
    """Write the flight page where it was asked for; beside the other results only where it can be made."""
    beside = options.out is not None and not options.no_html
    if options.html is None and not beside:
        return
    from ..pages.flight import replay_page  # noqa: PLC0415  (only who wants a page waits for it)

    mission = next((each for each in configuration.plans if each.mission.id == outcome.mission.id), None)
    page = replay_page(plan, recordings, outcome, mission)
    if options.html is not None:
        page.write(options.html)
    if beside:
        try:
            page.write(options.out / "flight.html")
        except PageError as error:
            sys.stderr.write(f"amaze-replay: no flight.html: {error}\n")


def _say_speed(outcome: Outcome, took_s: float) -> None:
    if sys.stderr.isatty():
        ratio = (outcome.end_ns - outcome.start_ns) / 1e9 / max(took_s, 1e-9)
        sys.stderr.write(f"replayed in {took_s:.2f} s, {ratio:.0f} x real time\n")


def _followed(options: argparse.Namespace) -> Tuple[Path, Sequence[str]]:
    """Return a folder and the overrides on top of it that make the configuration: those are followed.

    A changed copy of the folder that ships is that folder with the keys in which it differs.
    """
    keys = None if options.config is None else keys_of(options.config, options.set, config_folder())
    return (options.config or config_folder(), options.set) if keys is None else (config_folder(), keys)


class _Given:
    """The rules that the command line names for a journal, and its keys, which are followed."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.rules: Optional[Rules] = None  # None: those of the journal
        self._hash, self._folder = "", config_folder()
        self._keys: Sequence[str] = ()
        if options.config is not None or options.set:
            configuration = load_configuration(options.config or config_folder(), options.set)
            self.rules, self._hash = configuration.rules, configuration.hash
            self._folder, self._keys = _followed(options)

    def followed(self, journal: Journal) -> DecidedKeys:
        """Return what follows the keys through a journal; what it was flown by is not changed by them."""
        header = journal.lines[0].payload
        as_flown = isinstance(header, dict) and header.get("hash") == self._hash
        return DecidedKeys(() if as_flown else self._keys, lambda some: load_configuration(self._folder, some))


def _journal(options: argparse.Namespace) -> int:
    if options.html is not None:
        need_plots()
        check_output(options.html, "--html", Kind("page", is_document), [options.file])
    given = _Given(options)
    journals = read_journals(options.file, options.topic, options.memory)
    comparisons: List[Comparison] = []
    for journal in journals:
        keys, total = given.followed(journal), len(journal.lines)
        with progress_bar("deciding again") as progress:
            found = compare(journal, given.rules, _of(total, progress), keys.followed)
        unread = keys.unread(unread_in_journal, codes_recorded=not found.differences)
        comparisons.append(replace(found, unread=unread))
    if options.json:
        show_lines([json.dumps([comparison_result(each) for each in comparisons], indent=1)])
    else:
        for each in comparisons:
            show_lines(comparison_lines(each))
    if options.html is not None:
        from ..pages.flight import journal_page  # noqa: PLC0415

        journal_page(options.file, journals[-1], comparisons[-1], given.rules, options.memory).write(options.html)
    if any(each.differences for each in comparisons):
        return DIFFERENT
    if any(each.truncated or not each.events for each in comparisons):
        return PARTIAL
    return VACUOUS if any(each.unread for each in comparisons) else DONE


def _of(total: int, progress: Callable[[int, int], None]) -> Callable[[int], None]:
    """Return what takes how much of a whole is done."""
    return lambda done: progress(done, total)


def _laws(options: argparse.Namespace) -> int:
    given = _Given(options)
    found: List[Lawful] = []
    for journal in read_journals(options.file, options.topic, options.memory):
        keys, total = given.followed(journal), len(journal.lines)
        with progress_bar("checking the laws") as progress:
            lawful = check_laws(journal, given.rules, _of(total, progress), keys.followed)
        unread = keys.unread(unread_in_journal, codes_recorded=not lawful.judged.broken)
        found.append(replace(lawful, unread=unread))
    if options.json:
        show_lines([json.dumps([laws_result(each) for each in found], indent=1)])
    else:
        for each in found:
            show_lines(law_lines(each))
    if any(each.judged.broken for each in found):
        return DIFFERENT
    other = [each.truncated or not each.judged.events or (each.different and given.rules is None) for each in found]
    if any(other):
        return PARTIAL
    return VACUOUS if any(each.unread for each in found) else DONE


if __name__ == "__main__":
    raise SystemExit(main())
