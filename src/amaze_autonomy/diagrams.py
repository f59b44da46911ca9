"""The pictures of the documentation that are drawn from tables: the engine's states, and who talks to whom (SVG).

Each brings its own background, as the pictures of the console do, so that it is readable on light and dark pages.
"""

from __future__ import annotations

from typing import Callable, Dict, List, Mapping, NamedTuple, Sequence, Tuple
from xml.sax.saxutils import escape

from .engine.state import State
from .engine.transitions import TRANSITIONS, Transition, places_of
from .interface import PEERS, SERVICES, STATUSES
from .pages.contents import STATE_COLOURS

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
