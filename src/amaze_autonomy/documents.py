"""What is generated from the code's tables: parts of README.md and docs/, between markers, pictures, autonomy.yaml.

    <!-- generated:severities -->
    (made by the function of that name, never by hand)
    <!-- end -->

Each part is a row of `_PARTS`, and stands wherever a page has its markers; those of the configuration are made with it.
Each picture is a row of `diagrams.PICTURES`, and a file in docs/images.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Callable, Iterable, List, Mapping, Sequence, Tuple

from . import paths
from .autopilot.vehicle.client import ASKED_FOR
from .config import load_configuration
from .config.document import Items, Scalar, Table
from .config.errors import Place
from .config.reference import DOCUMENTS as CONFIGURATION
from .config.reference import group_reference, shipped_file
from .diagrams import PICTURES
from .engine.commands import MESSAGES, AnswerKind
from .engine.context import MISSION_MODE, MODES, SET_POINT_MODE, without_others
from .engine.decide import ANSWERS, OTHERWISE, SELECT
from .engine.events import UserCommand
from .engine.failsafe import FAILSAFE_CONDITIONS
from .engine.rules import SEVERITIES, Rules
from .engine.state import State, Step
from .engine.timers import TIMERS
from .engine.transitions import TRANSITIONS, Source
from .interface import PEERS, SERVICES
from .replay.faults import RECORDED_KINDS, TOPIC
from .replay.maps.topic_map import SCHEMA, load_map, map_names
from .simulation import Subject
from .simulation.scenario import EVENTS, KINDS, FaultKind, Parameter
from .simulation.scenario_file import load_scenario
from .tester.expect import EXPECTATIONS, ExpectationKind
from .tester.scenario.model import schema_of

_BEGIN, _END = "<!-- generated:", "<!-- end -->"
_MARKED = re.compile(
    r"(?P<begin><!-- generated:(?P<name>[^ \n]+) -->\n)(?P<text>(?:(?!<!-- generated:).)*?)(?P<end><!-- end -->)",
    re.DOTALL,
)


class DocumentError(ValueError):
    """A page has a marker that nothing is generated for, or half a pair of markers."""


def documents() -> Mapping[str, Callable[[], str]]:
    """Return every part that can be generated, by the name of its marker."""
    return {**_PARTS, **CONFIGURATION}


def _names(page: str) -> Tuple[str, ...]:
    """Return the names of the generated parts of a page, in order."""
    return tuple(found["name"] for found in _MARKED.finditer(page))


def filled(page: str, parts: Mapping[str, Callable[[], str]]) -> str:
    """Return a page with its generated parts made anew.

    Raises:
        DocumentError: a marker has no function, or no partner.
    """
    for name in _names(page):
        if name not in parts:
            raise DocumentError(f"nothing is generated for the marker {name}; there is {', '.join(sorted(parts))}")
    pairs = len(_names(page))
    if page.count(_BEGIN) != pairs or page.count(_END) != pairs:
        raise DocumentError(f"{page.count(_BEGIN)} markers begin a generated part, {page.count(_END)} end one")
    return _MARKED.sub(lambda found: f"{found['begin']}\n{parts[found['name']]().strip()}\n\n{found['end']}", page)


def regenerated(folder: Path) -> Tuple[Tuple[Path, str, str], ...]:
    """Return every page of a folder, and README.md beside it: path, text, and the text with its parts made anew.

    Raises:
        DocumentError: a page's markers are wrong.
    """
    parts, pages = documents(), []
    for path in [*sorted(folder.glob("*.md")), *folder.parent.glob("README.md")]:
        old = path.read_text(encoding="utf-8")
        try:
            pages.append((path, old, filled(old, parts)))
        except DocumentError as error:
            raise DocumentError(f"{path}: {error}") from None
    return tuple(pages)


def shipped_configuration() -> Tuple[Path, str, str]:
    """Return autonomy.yaml as it ships: its path, its text, and the text made anew from the engine's limits."""
    path = paths.config_folder() / "autonomy.yaml"
    return path, path.read_text(encoding="utf-8"), shipped_file("autonomy")


def drawn(folder: Path) -> Tuple[Tuple[Path, str, str], ...]:
    """Return every picture of a folder of pages that is drawn from tables: path, what is there, what should be."""
    paths_of = {folder / "images" / f"{name}.svg": draw for name, draw in PICTURES.items()}
    return tuple(
        (path, path.read_text(encoding="utf-8") if path.is_file() else "", draw()) for path, draw in paths_of.items()
    )


def not_shown(pages: Iterable[str]) -> Tuple[str, ...]:
    """Return the names of the parts that stand in none of the pages."""
    shown = [name for page in pages for name in _names(page)]
    return tuple(name for name in documents() if name not in shown)


def first_difference(old: str, new: str) -> Tuple[int, str, str]:
    """Return line number and both lines where two different texts first differ."""
    before, after = old.split("\n"), new.split("\n")
    for number, (one, other) in enumerate(zip(before, after), start=1):
        if one != other:
            return number, one, other
    number = min(len(before), len(after))
    return number + 1, "\n".join(before[number : number + 1]), "\n".join(after[number : number + 1])


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


# --- engine -----------------------------------------------------------------------------------------------------------


def _place(source: Source) -> str:
    if isinstance(source, tuple):
        state, step = source
        return f"{state.value}.{step.value}" if step is not Step.NONE else state.value
    return source.value


def _severity_table() -> str:
    """Return the table of severities."""
    rows = [
        (
            severity.value,
            int(row.code),
            int(row.code_given_up),
            f"`{row.action.name.lower()}`",
            f"`{row.fallback.name.lower()}`" if row.fallback else "",
        )
        for severity, row in SEVERITIES.items()
    ]
    return _table(("Severity", "Code when it fails", "Code when restarting has failed", "Action", "Fallback"), rows)


def _loss_table() -> str:
    """Return the table of what else can be lost in flight."""
    rows = [
        (
            f"`{row.name}`",
            row.words,
            f"`{row.action.name.lower()}`",
            "yes" if row.both_routes else "",
            "yes" if row.alarm else "",
        )
        for row in FAILSAFE_CONDITIONS
    ]
    return _table(("Row", "In words", "Action", "Both routes at once", "Alarm to the pilot"), rows)


def decision_table(rules: Rules) -> str:
    """Return the decision table of a configuration."""
    rows = []
    for rule in rules.components:
        row = SEVERITIES[rule.severity]
        words = row.action.name.lower() + (
            f" up to {rule.wait_limit_ns / 1e9:g} s, then {row.fallback.name.lower()}" if row.fallback else ""
        )
        rows.append((f"`{rule.name}`", rule.group, "yes" if rule.restart else "never", rule.severity.value, words))
    return _table(("Component", "Group", "Restart", "Severity", "Result"), rows)


def _transition_table() -> str:
    """Return the transition table, in its order."""
    rows = [
        (
            f"`{row.rule}`",
            ", ".join(_place(source) for source in row.sources),
            row.words,
            _place(row.target) if row.target is not None else "(stays)",
            f"`{row.message}`" if row.message else "",
        )
        for row in TRANSITIONS
    ]
    return _table(("Rule", "From", "When", "To", "Message"), rows)


def _answer_table() -> str:
    """Return what every command of the user is answered in every state."""
    rows = []
    for state in State:
        cells = [SELECT[state].answer.name.lower()]
        for command in UserCommand:
            cases = ANSWERS[command].get(state, ())
            texts = [
                f"{case.answer.name.lower()}" + ("" if case.when == "always" else f" ({case.when})") for case in cases
            ]
            if not cases or cases[-1].when != "always":
                texts.append(AnswerKind.REFUSED.name.lower())
            cells.append(", ".join(texts))
        rows.append((state.value, *cells))
    head = ("State", "select", *(command.value for command in UserCommand))
    reasons = "\n".join(f"* `{command.value}` otherwise: {text}" for command, text in OTHERWISE.items())
    return _table(head, rows) + "\n" + reasons + "\n"


def _message_table() -> str:
    """Return every message to the user."""
    rows = [(f"`{key}`", entry.level.name, entry.text, entry.advice) for key, entry in MESSAGES.items()]
    return _table(("Message", "Level", "Text", "What you can do"), rows)


def _timer_table() -> str:
    """Return every wait of the engine."""
    rows = [
        (f"`{timer.name}`", ", ".join(_place(place) for place in timer.places), "yes" if timer.ends_state else "")
        for timer in TIMERS
    ]
    return _table(("Timer", "Where", "Ends the state by itself"), rows)


def _mode_table() -> str:
    """Return which flight modes answer which command."""
    ways = [without_others(MODES, way) for way in ("", MISSION_MODE, SET_POINT_MODE)]
    flown = ("once AUTO.MISSION was flown", "once OFFBOARD was, with `controller: offboard`")
    head = ("Command", "Flight modes that are ours", *flown)
    return _table(head, [(a.name, *(", ".join(sorted(modes[a])) for modes in ways)) for a in MODES])


def _shipped_decision_table() -> str:
    return decision_table(load_configuration(paths.config_folder()).rules)


# --- simulation -------------------------------------------------------------------------------------------------------


_SUBJECTS = {
    Subject.COMPONENT: "### `component:` a component of sensors.yaml",
    Subject.PROCESS: f"### `process:` a peer of the engine\n\nOne of {', '.join(f'`{name}`' for name in PEERS)}.",
    Subject.SERVICE: f"### `service:` a service of a peer\n\nOne of {', '.join(f'`{name}`' for name in SERVICES)}.",
    Subject.WORLD: "### Vehicle, battery, pilot, recording: no target",
}


def _parameter(parameter: Parameter) -> str:
    """Return a parameter in words: name, what it means, default or what it must be."""
    said = f"`{parameter.name}`: {parameter.words}"
    if parameter.choices:
        said += f" ({', '.join(parameter.choices)})"
    if parameter.default is None:
        return f"{said}; must be given"
    return said if parameter.default == "" else f"{said}; default {parameter.default}"


def _words(kind: FaultKind) -> str:
    """Return what a kind of fault does, and to whom when not to all."""
    return f"{kind.words} ({', '.join(kind.targets)} only)" if kind.targets else kind.words


def _kinds_of_faults() -> str:
    """Return every kind of fault, by subject."""
    parts: List[str] = []
    for subject, head in _SUBJECTS.items():
        parts.append(f"{head}\n\n{_kinds_table(kind for kind in KINDS.values() if kind.subject == subject)}")
    return "\n".join(parts)


def _kinds_table(kinds: Iterable[FaultKind]) -> str:
    """Return some kinds of faults as a table."""
    rows = [
        (f"`{kind.name}`", _words(kind), "<br>".join(_parameter(each) for each in kind.parameters)) for kind in kinds
    ]
    return _table(("fault", "what it does", "parameters"), rows)


def _events() -> str:
    """Return every event that a trigger can wait for."""
    return _table(("event", "when"), ((f"`{name}`", words) for name, words in EVENTS.items()))


def _shipped_scenarios() -> str:
    """Return every scenario that ships with the package."""
    files = sorted((paths.config_folder() / "faults").glob("*.yaml"))
    return _table(("name", "what happens"), ((f"`{file.stem}`", load_scenario(file).description) for file in files))


# --- replay and tester ------------------------------------------------------------------------------------------------


_HEADS = {
    TOPIC: "### `topic:` a topic that the map reads",
    Subject.COMPONENT: "### `component:` all topics of a component",
    Subject.PROCESS: "### `process:` what a peer says, and the engine itself",
    Subject.SERVICE: "### `service:` what the scripted peers answer",
    Subject.WORLD: "### The whole recording: no target",
}


def _expectations() -> str:
    rows = [(f"`{kind.name}`", _keys(kind), kind.words) for kind in EXPECTATIONS.values()]
    return _table(("`expect`", "Keys", "Holds when"), rows)


def _keys(kind: ExpectationKind) -> str:
    patterns = ", ".join(f"`{name}`{' (a list)' if kind.many else ''}" for name in kind.patterns)
    numbers = " or ".join(f"`{name}`" for name in kind.numbers)
    return f"{patterns}; {numbers}{'' if kind.needs else ' if wanted'}" if numbers else patterns


def _faults() -> str:
    parts: List[str] = []
    for subject, head in _HEADS.items():
        kinds = [kind for kind in RECORDED_KINDS.values() if kind.subject == subject]
        parts.append(f"{head}\n\n{_kinds_table(kinds)}")
    return "\n".join(parts)


def _scenario() -> str:
    """Return the keys of a scenario on bags, which has the most."""
    place = Place("")
    tree = Table(place, {"bags": (place, Items(place, (Scalar(place, "", "str"),)))})
    return group_reference(schema_of(tree))


def _topic_map() -> str:
    return group_reference(SCHEMA)


def _topic_maps() -> str:
    rows = "".join(f"| `{name}` | {load_map(name).about} |\n" for name in map_names())
    return f"| Map | Recording |\n|---|---|\n{rows}"


# --- autopilot --------------------------------------------------------------------------------------------------------


def _asked_for() -> str:
    """Return the messages that the autopilot's node asks for."""
    rows = ((f"`{name}`", f"{rate_hz:g}", why) for name, (rate_hz, why) in ASKED_FOR.items())
    return _table(("message", "Hz", "what for"), rows)


_PARTS: Mapping[str, Callable[[], str]] = {
    "decision-table": _shipped_decision_table,
    "severities": _severity_table,
    "losses": _loss_table,
    "transitions": _transition_table,
    "answers": _answer_table,
    "messages": _message_table,
    "timers": _timer_table,
    "modes": _mode_table,
    "fault-kinds": _kinds_of_faults,
    "fault-events": _events,
    "scenarios": _shipped_scenarios,
    "topic-map": _topic_map,
    "topic-maps": _topic_maps,
    "scenario-keys": _scenario,
    "expectations": _expectations,
    "recorded-faults": _faults,
    "asked-for": _asked_for,
}
"""By the name of the marker in a page."""
