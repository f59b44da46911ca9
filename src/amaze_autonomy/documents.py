"""What is generated from the code's tables: parts of README.md and docs/, between markers, pictures, autonomy.yaml.

    <!-- generated:severities -->
    (made by the function of that name, never by hand)
    <!-- end -->

Each part is a row of `_PARTS`, and stands wherever a page has its markers; those of the configuration are made with it.
Each picture is a row of `PICTURES`, and a file in docs/images.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Callable, Dict, Iterable, List, Mapping, NamedTuple, Sequence, Tuple
from xml.sax.saxutils import escape

from . import paths
from .autopilot.vehicle.client import ASKED_FOR
from .config import load_configuration
from .config.reference import DOCUMENTS as CONFIGURATION
from .config.reference import group_reference, shipped_file
from .config.schema import Group
from .engine.commands import MESSAGES, AnswerKind
from .engine.context import MISSION_MODE, MODES, SET_POINT_MODE, without_others
from .engine.decide import ANSWERS, OTHERWISE, SELECT
from .engine.events import UserCommand
from .engine.failsafe import FAILSAFE_CONDITIONS
from .engine.rules import SEVERITIES, Rules
from .engine.state import State, Step
from .engine.timers import TIMERS
from .engine.transitions import TRANSITIONS, Source, Transition, places_of
from .interface import PEERS, SERVICES, STATUSES
from .pages.contents import STATE_COLOURS
from .replay.faults import RECORDED_KINDS, TOPIC
from .replay.maps.topic_map import SCHEMA, load_map, map_names
from .simulation import Subject
from .simulation.scenario import EVENTS, KINDS, FaultKind, Parameter
from .simulation.scenario_file import load_scenario
from .tester.expect import EXPECTATIONS, ExpectationKind
from .tester.scenario.model import IN_EVERY, SOURCES, SourceKind

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


_OF_A_SOURCE = {
    SourceKind.BAGS: "with `bags`",
    SourceKind.JOURNAL: "with `journal`",
    SourceKind.EVENTS: "with `events`",
    SourceKind.SIMULATION: "with none of them: a simulated flight",
}


def _scenario() -> str:
    """Return the keys of a scenario: those of every one, then those of each source of events."""
    parts = [f"### Keys {_OF_A_SOURCE[kind]}\n\n{group_reference(Group(kind, keys))}" for kind, keys in SOURCES.items()]
    return "\n".join((f"### Keys of every scenario\n\n{group_reference(Group('', IN_EVERY))}", *parts))


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


# --- pictures ---------------------------------------------------------------------------------------------------------
# The pictures of the documentation that are drawn from tables: the engine's states, and who talks to whom (SVG).
#
# Each brings its own background, as the pictures of the console do, so that it is readable on light and dark pages.


BACK, FORE, _DARK, _QUIET = "#101418", "#e8e8e8", "#000000", "#9aa4ae"
_MARGIN, _LETTER, _LINE = 14, 6.1, 16  # a letter of 10 px is 6.02 px wide in the fonts named below

Way = Tuple[State, State]
Point = Tuple[float, float]


class _Drawing:
    """What is drawn so far, from the back to the front."""

    def __init__(self) -> None:
        self.parts: List[str] = []

    def line(
        self, points: Sequence[Point], colour: str, *, width: float = 1.2, arrow: bool = False, dots: str = ""
    ) -> None:
        """Draw a line through points; an arrow has its head at the last one, and is horizontal or vertical there."""
        path = "M" + " L".join(f"{x:g} {y:g}" for x, y in points)
        dashes = f' stroke-dasharray="{dots}"' if dots else ""
        self.parts.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}"{dashes}/>')
        if arrow:
            (x0, y0), (x, y) = points[-2:]
            dx, dy = (x > x0) - (x < x0), (y > y0) - (y < y0)
            head = [(x, y), (x - 8 * dx - 4 * dy, y - 8 * dy - 4 * dx), (x - 8 * dx + 4 * dy, y - 8 * dy + 4 * dx)]
            self.parts.append(f'<path d="M{" L".join(f"{a:g} {b:g}" for a, b in head)} Z" fill="{colour}"/>')

    def dot(self, at: Point, colour: str, radius: float = 2.6) -> None:
        """Draw where lines meet."""
        self.parts.append(f'<circle cx="{at[0]:g}" cy="{at[1]:g}" r="{radius:g}" fill="{colour}"/>')

    def text(self, at: Point, words: str, *, anchor: str = "start", colour: str = FORE, bold: bool = False) -> None:
        """Write on a line; the anchor says which end of the words is at the point."""
        weight = ' font-weight="bold"' if bold else ""
        self.parts.append(
            f'<text x="{at[0]:g}" y="{at[1]:g}" text-anchor="{anchor}" fill="{colour}"{weight}>{escape(words)}</text>'
        )

    def box(self, at: Point, size: Point, words: str, colour: str, radius: int = 4) -> None:
        """Draw a box with words in its middle."""
        (x, y), (wide, high) = at, size
        self.parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{wide:g}" height="{high:g}" rx="{radius}" fill="{colour}"/>'
        )
        self.text((x + wide / 2, y + high / 2 + 3.5), words, anchor="middle", colour=_DARK, bold=True)

    def svg(self, size: Point, title: str) -> str:
        """Return the picture; its title is for those who cannot see it."""
        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]:g} {size[1]:g}" role="img" font-size="10" '
            'font-family="DejaVu Sans Mono, ui-monospace, Menlo, Consolas, monospace">',
            f"<title>{escape(title)}</title>",
            f'<rect width="{size[0]:g}" height="{size[1]:g}" rx="8" fill="{BACK}"/>',
        ]
        return "\n".join([*lines, *self.parts, "</svg>", ""])


# --- the states -------------------------------------------------------------------------------------------------------

_BOX, _HEAD, _GAP, _LABEL, _LANE = 124, 20, 12, 38, 12


class _Lane(NamedTuple):
    """The line to a state from all below it, or from all above it: how high they join it, how high it ends."""

    sources: Tuple[float, ...]
    end: float
    target: State
    column: int = 0

    @property
    def span(self) -> Tuple[float, float]:
        """From where to where it leads, downwards."""
        return min(self.end, *self.sources), max(self.end, *self.sources)


def ways() -> Mapping[Way, Tuple[str, ...]]:
    """Return the rules that lead from one state to another, by both."""
    found: Dict[Way, Tuple[str, ...]] = {}
    for row in TRANSITIONS:
        for way in _ways_of(row):
            found[way] = (*found.get(way, ()), row.rule)
    order = list(State)
    return {way: found[way] for way in sorted(found, key=lambda way: tuple(map(order.index, way)))}


def _ways_of(row: Transition) -> Sequence[Way]:
    if row.target is None:
        return ()
    target = row.target[0]
    sources = dict.fromkeys(place[0] for source in row.sources for place in places_of(source))
    return [(source, target) for source in sources if source is not target]


def state_diagram() -> str:
    """Return the engine's states in the order of a flight, and every way between them.

    A way on is on the right and leads down, a way back is on the left and leads up; ways to one state share a lane.
    """
    rules, drawing = ways(), _Drawing()
    rows = {
        way: [each for each in rules if each[0] is way[0] and _side(each) == _side(way)].index(way) + 1 for way in rules
    }
    tops, y = {}, 2.0 * _MARGIN
    for state in State:
        tops[state] = y
        y += _HEAD + _GAP + _LINE * max((row for way, row in rows.items() if way[0] is state), default=0)
    at = {way: tops[way[0]] + _HEAD + _LINE * row - 4 for way, row in rows.items()}
    lanes = {side: _lanes(side, at, tops) for side in (-1, 1)}
    beside = {side: _LABEL * _LETTER + _LANE * (1 + max(lane.column for lane in lanes[side])) for side in lanes}
    left = _MARGIN + beside[-1]
    edges = {-1: left, 1: left + _BOX}
    for side, lanes_of_side in lanes.items():
        for lane in lanes_of_side:
            _draw_lane(drawing, lane, edges[side], side)
    for way, names in rules.items():
        place = (edges[_side(way)] + 6 * _side(way), at[way] - 4)
        drawing.text(place, _label(names), anchor="start" if _side(way) > 0 else "end")
    middle = left + _BOX / 2
    drawing.dot((middle, _MARGIN - 2), FORE, 4)
    drawing.line([(middle, _MARGIN), (middle, 2 * _MARGIN)], FORE, arrow=True)
    for state, end in zip(State, [*list(tops.values())[1:], y]):
        drawing.box((left, tops[state]), (_BOX, end - tops[state] - _GAP), state.value, STATE_COLOURS[state.value])
    size = (round(edges[1] + beside[1] + _MARGIN), y - _GAP + _MARGIN)
    return drawing.svg(size, "The engine's states and the ways between them")


def _side(way: Way) -> int:
    """Return 1 for a way on, which is on the right of the states, and -1 for a way back, on the left."""
    order = list(State)
    return 1 if order.index(way[1]) > order.index(way[0]) else -1


def _lanes(side: int, at: Mapping[Way, float], tops: Mapping[State, float]) -> Sequence[_Lane]:
    """Return the lanes on one side, each in the nearest column where it meets no other."""
    found = [
        _Lane(tuple(at[way] for way in at if way[1] is target and _side(way) == side), tops[target] + _HEAD / 2, target)
        for target in dict.fromkeys(target for source, target in at if _side((source, target)) == side)
    ]
    placed: List[_Lane] = []
    for lane in sorted(found, key=lambda each: each.span[1] - each.span[0]):
        taken = {each.column for each in placed if each.span[0] - 4 < lane.span[1] and lane.span[0] < each.span[1] + 4}
        placed.append(lane._replace(column=min(set(range(len(found))) - taken)))
    return placed


def _draw_lane(drawing: _Drawing, lane: _Lane, edge: float, side: int) -> None:
    x = edge + side * (_LABEL * _LETTER + _LANE * (lane.column + 0.5))
    colour = STATE_COLOURS[lane.target.value]
    for y in lane.sources:
        drawing.line([(edge, y), (x, y)], colour)
        drawing.dot((x, y), colour)
    drawing.line([(x, lane.span[side < 0]), (x, lane.end), (edge, lane.end)], colour, width=2, arrow=True)


def _label(rules: Sequence[str]) -> str:
    """Return as many rules as there is room for, and how many more there are."""
    for count in range(len(rules), 1, -1):
        left = len(rules) - count
        words = ", ".join(rules[:count]) + (f" and {left} more" if left else "")
        if len(words) <= _LABEL:
            return words
    return rules[0] + (f" and {len(rules) - 1} more" if rules[1:] else "")


# --- who talks to whom ------------------------------------------------------------------------------------------------

_SOURCES: Mapping[str, Tuple[str, ...]] = {
    "sensors, drivers": ("watchdog", "landing_detection", "state_estimation", "data_recorder"),
    "vehicle, MAVLink": ("autopilot", "mission_planner"),
}
"""What the peers look at, in the picture of all."""

_ENGINE, _PEER, _SOURCE, _BETWEEN, _ROW = 130, 136, 132, 260, 54
_ENGINE_COLOUR, _PEER_COLOUR, _WORLD_COLOUR = (
    STATE_COLOURS[state.value] for state in (State.MISSION, State.TAKEOFF, State.HOLD)
)


def architecture() -> str:
    """Return who asks whom for what, and who says what to the engine."""
    drawing, top = _Drawing(), _MARGIN + 64
    peer_x = _MARGIN + _ENGINE + _BETWEEN
    middle = {peer: top + _ROW * (row + 0.5) for row, peer in enumerate(PEERS)}
    drawing.line([(_MARGIN + _ENGINE / 2, top - 20), (_MARGIN + _ENGINE / 2, top)], FORE, arrow=True)
    drawing.line([(_MARGIN + _ENGINE / 2, top - 20), (_MARGIN + _ENGINE / 2, _MARGIN + 28)], FORE, arrow=True)
    drawing.text((_MARGIN + _ENGINE / 2 + 10, top - 14), "console, page")
    drawing.box((_MARGIN, _MARGIN), (_ENGINE, 28), "operator", _WORLD_COLOUR, 14)
    drawing.box((_MARGIN, top), (_ENGINE, _ROW * len(PEERS)), "autonomy: the engine", _ENGINE_COLOUR)
    for peer, y in middle.items():
        asked = [name.split("/", 1)[1] for name, service in SERVICES.items() if service.peer == peer]
        said = [status.topic.split("/", 1)[1] for status in STATUSES if status.topic.split("/", 1)[0] == peer]
        for words, dy, dots in ((asked, -8, ""), (said, 14, "4 3")):
            if words:
                ends = [(_MARGIN + _ENGINE, y + dy), (peer_x, y + dy)]
                drawing.line(ends[::-1] if dots else ends, _QUIET if dots else FORE, arrow=True, dots=dots)
                place = (_MARGIN + _ENGINE + _BETWEEN / 2, y + dy - 5)
                drawing.text(place, ", ".join(words), anchor="middle", colour=_QUIET if dots else FORE)
        drawing.box((peer_x, y - 19), (_PEER, 38), peer.replace("_", " "), _PEER_COLOUR)
    _draw_world(drawing, peer_x + _PEER, middle)
    return drawing.svg(
        (peer_x + _PEER + 84 + _SOURCE + _MARGIN, top + _ROW * len(PEERS) + _MARGIN), "Who talks to whom"
    )


def _draw_world(drawing: _Drawing, edge: float, middle: Mapping[str, float]) -> None:
    """Draw what the peers look at, and what is left of a flight."""
    for number, (source, peers) in enumerate(_SOURCES.items()):
        lane, y = edge + 30 + 24 * number, middle[peers[0]] - 6
        for peer in peers:
            end = middle[peer] - 6
            drawing.line([(edge + 84, y), (lane, y), (lane, end), (edge, end)], _WORLD_COLOUR, arrow=True)
        drawing.box((edge + 84, y - 19), (_SOURCE, 38), source, _WORLD_COLOUR, 14)
    y = middle["data_recorder"] + 8
    drawing.line([(edge, y), (edge + 84, y)], FORE, arrow=True)
    drawing.box((edge + 84, y - 19), (_SOURCE, 38), "one recording", STATE_COLOURS[State.DATA_CLEANUP.value], 14)


PICTURES: Mapping[str, Callable[[], str]] = {"states": state_diagram, "architecture": architecture}
"""By the name of the file in docs/images."""
