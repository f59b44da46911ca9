"""Plans of QGroundControl (`.plan`, JSON): mission items and the fence that was drawn with them.

Source: the file format of QGroundControl's documentation, fileType Plan, version 1. Taken are a takeoff as the first
item, waypoints and timed loiters, and a landing as the last item, all relative to home. Anything else (surveys, camera
commands, jumps, speeds, terrain) is refused: a plan is flown as it was drawn or not at all.
"""

from __future__ import annotations

import json
import json.decoder
import json.scanner
import math
import re
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, NoReturn, Optional, Sequence, Tuple, Union

from .csv_table import Said, lines_of
from .errors import WaypointError
from .fence import MOST_CORNERS
from .routes import Area, Route, RoutePoint, is_global, parse_route
from .waypoints import Home, Names, Place, Trajectory, parse_trajectory

# --- located json -----------------------------------------------------------------------------------------------------
# JSON in which every object knows its line, read strictly: no key twice, no NaN.


_DEEPEST = 100  # a plan has ten
_BRACKET = re.compile(r'"(?:[^"\\]|\\.)*"?|[][{}]', re.DOTALL)  # or a text, which may lack its end


class Object(Dict[str, Any]):
    """An object of a document, with its line from 1."""

    line = 0


class _Decoder(json.JSONDecoder):
    """Notes where each object begins; the scanner in Python asks `parse_object` for every one."""

    def __init__(self) -> None:
        super().__init__(object_pairs_hook=_object, parse_constant=_refuse)
        self._parse = json.decoder.JSONObject  # type: ignore[attr-defined]
        self.parse_object = self._located
        self.scan_once = json.scanner.py_make_scanner(self)  # type: ignore[attr-defined]

    def _located(self, s_and_end: Tuple[str, int], *rest: Any) -> Tuple[Object, int]:
        found, end = self._parse(s_and_end, *rest)
        found.line = s_and_end[0].count("\n", 0, s_and_end[1]) + 1
        return found, end


def _object(pairs: List[Tuple[str, Any]]) -> Object:
    found = Object(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"has the key {next(name for name in names if names.count(name) > 1)[:40]!r} twice")
    return found


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"holds {name}, which is no number")


def _depth(text: str) -> int:
    """Return how deep lists and objects are nested; brackets in texts do not count."""
    deep = deepest = 0
    for found in _BRACKET.finditer(text):
        deep += {"[": 1, "{": 1, "]": -1, "}": -1}.get(found[0], 0)
        deepest = max(deepest, deep)
    return deepest


def read_json(text: str, file: str) -> Object:
    """Read a document that is one object.

    Raises:
        WaypointError: it is none, with the line where that shows.
    """
    right = "must be a plan as QGroundControl saves it"
    if _depth(text) > _DEEPEST:  # not left to the decoder: it recurses, and an interpreter may end in that
        raise WaypointError(file, 0, "", "is nested too deeply", right)
    try:
        found = _Decoder().decode(text)
    except json.JSONDecodeError as error:
        raise WaypointError(file, error.lineno, "", f"is not JSON: {error.msg}", "must be a whole plan") from None
    except ValueError as error:
        raise WaypointError(file, 0, "", str(error), right) from None
    if not isinstance(found, Object):
        raise WaypointError(file, 1, "", "is no JSON object", right)
    return found


# --- plan file --------------------------------------------------------------------------------------------------------


_NAMES = Names("params 5,6", "params 7", "params 5,6,7", "params 1")
_FRAMES = (3, 6)  # MAV_FRAME_GLOBAL_RELATIVE_ALT and the same in integers
_PARAMS = 7
SAME_M = 0.5
"""Places that are no further apart are the same."""


class _Item(NamedTuple):
    number: int  # from 1
    line: int
    command: int
    params: Sequence[Optional[float]]


class _File:
    """A file whose mistakes are named."""

    def __init__(self, name: str) -> None:
        self.name = name

    def refuse(self, line: int, column: str, wrong: str, right: str) -> NoReturn:
        raise WaypointError(self.name, line, column, wrong, right)

    def part(self, parent: Object, key: str, kind: type, said: str) -> Any:
        """Return a part of an object, which must be there and of a kind."""
        found = parent.get(key)
        if not isinstance(found, kind):
            wrong = "is missing" if key not in parent else f"is {str(found)[:40]}"
            self.refuse(parent.line, key, wrong, f"must be {said}")
        return found

    def number(self, parent: Object, column: str, value: Any) -> float:
        """Return a finite number."""
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(_float(value)):
            self.refuse(parent.line, column, f"is {str(value)[:40]}", "must be a finite number")
        return float(value)

    def place(self, parent: Object, column: str, latitude: Any, longitude: Any) -> Place:
        """Return a place on the earth."""
        place = Place(self.number(parent, column, latitude), self.number(parent, column, longitude))
        if abs(place.latitude_deg) > 90.0 or abs(place.longitude_deg) > 180.0:  # noqa: PLR2004
            wrong = f"is {place.latitude_deg:g}, {place.longitude_deg:g}"
            self.refuse(parent.line, column, wrong, "must be a latitude and a longitude in degrees")
        return place


def _float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def parse_plan(text: str, name: str) -> Route:
    """Read a whole plan.

    Raises:
        WaypointError: the first mistake in it, with line and column.
    """
    file = _File(name)
    plan = read_json(text, name)
    if plan.get("fileType") != "Plan" or plan.get("version") != 1:
        file.refuse(plan.line, "fileType", f"is {str(plan.get('fileType'))[:40]}", "must be Plan, of version 1")
    mission = file.part(plan, "mission", Object, "the mission")
    home = _home(file, mission)
    items = [
        _item(file, number, each, mission)
        for number, each in enumerate(file.part(mission, "items", list, "a list of items"), start=1)
    ]
    _refuse_rally_points(file, plan)
    points = _points(file, items)
    if not points:
        file.refuse(mission.line, "items", "has no waypoints", "must have at least one item of command 16")
    return Route(name, tuple(points), _NAMES, home, tuple(_fence(file, plan)), mission.line)


def _home(file: _File, mission: Object) -> Home:
    values = file.part(mission, "plannedHomePosition", list, "latitude, longitude and altitude of home")
    if len(values) < 2:  # noqa: PLR2004
        file.refuse(mission.line, "plannedHomePosition", "is too short", "must be latitude, longitude, altitude")
    return Home(*file.place(mission, "plannedHomePosition", values[0], values[1]))


def _refuse_rally_points(file: _File, plan: Object) -> None:
    """Refuse places to flee to: a landing is where the vehicle is, and what was drawn would not be flown."""
    rally = plan.get("rallyPoints")
    right = "must have none: nobody flies to them, so remove them in QGroundControl and save the plan again"
    if not rally:
        return
    if not isinstance(rally, Object):
        file.refuse(plan.line, "rallyPoints", f"is {str(rally)[:40]}", right)
    for key, value in rally.items():
        if value and key != "version":
            file.refuse(rally.line, "rallyPoints", f"has {key[:40]}", right)


def _item(file: _File, number: int, item: Any, mission: Object) -> _Item:
    if not isinstance(item, Object):
        file.refuse(mission.line, f"item {number}", "is no object", "must be a mission item")
    kind, command = item.get("type"), item.get("command")
    if kind != "SimpleItem" or not isinstance(command, int):
        what = str(item.get("complexItemType", kind))[:40]
        file.refuse(item.line, f"item {number}", f"is of the type {what}", "must be a simple item, e.g. a waypoint")
    if item.get("frame") not in _FRAMES:
        right = "must be 3, metres above the takeoff (AltitudeMode: relative)"
        file.refuse(item.line, f"item {number}: frame", f"is {str(item.get('frame'))[:40]}", right)
    if item.get("autoContinue", True) is not True:
        right = "must be true: nobody is asked between two items"
        file.refuse(item.line, f"item {number}: autoContinue", f"is {str(item['autoContinue'])[:40]}", right)
    params = file.part(item, "params", list, "a list of seven numbers")
    if len(params) != _PARAMS:
        file.refuse(item.line, f"item {number}: params", f"has {len(params)} values", "must have seven")
    values = [None if value is None else file.number(item, f"item {number}: params", value) for value in params]
    return _Item(number, item.line, command, values)


def _points(file: _File, items: Sequence[_Item]) -> List[RoutePoint]:
    points: List[RoutePoint] = []
    for item in items:
        if item.command not in _COMMANDS:
            right = f"must be one of {', '.join(f'{each} ({_SAID[each]})' for each in _COMMANDS)}"
            file.refuse(item.line, f"item {item.number}", f"is command {item.command}", right)
        if item.command == _TAKEOFF and item.number != 1:
            file.refuse(item.line, f"item {item.number}", "takes off in flight", "must be the first item")
        if item.command == _LAND and item.number != len(items):
            file.refuse(item.line, f"item {item.number}", "lands before the end", "must be the last item")
        points.extend(_COMMANDS[item.command](file, item, points))
    return points


def _given(file: _File, item: _Item) -> Tuple[Place, float]:
    """Return place and height of an item."""
    latitude, longitude, height = (_value(file, item, index) for index in (4, 5, 6))
    parent = Object()
    parent.line = item.line
    return file.place(parent, f"item {item.number}: params 5,6", latitude, longitude), height


def _value(file: _File, item: _Item, index: int) -> float:
    """Return a parameter that must be given; `index` from 0."""
    value = item.params[index]
    if value is None:
        file.refuse(item.line, f"item {item.number}: params {index + 1}", "is null", "must be a number")
    return value


def _is_here(item: _Item) -> bool:
    """Return whether an item has no place of its own: QGroundControl saves zeros then, or nothing."""
    return not item.params[4] and not item.params[5]


def _takeoff(file: _File, item: _Item, _: Sequence[RoutePoint]) -> List[RoutePoint]:
    """Return the end of the climb: above where the file takes off, or above a place of its own."""
    place, height = (None, _value(file, item, 6)) if _is_here(item) else _given(file, item)
    return [RoutePoint(place, height, _yaw(item), 0.0, item.line, takeoff=True)]


def _waypoint(file: _File, item: _Item, _: Sequence[RoutePoint]) -> List[RoutePoint]:
    place, height = _given(file, item)
    _refuse_unflown(file, item)
    return [RoutePoint(place, height, _yaw(item), item.params[0] or 0.0, item.line)]


def _refuse_unflown(file: _File, item: _Item) -> None:
    """Refuse parameters that ask for what is not flown."""
    for index, what, right in _UNFLOWN.get(item.command, ()):
        value = item.params[index]
        if value:
            file.refuse(item.line, f"item {item.number}: params {index + 1}", f"is {value:g} ({what})", right)


def _land(file: _File, item: _Item, points: Sequence[RoutePoint]) -> List[RoutePoint]:
    """Return the place above the landing, at the height of the last waypoint; none when it is there already."""
    if not points:
        file.refuse(item.line, f"item {item.number}", "lands before anything was flown", "must follow a waypoint")
    _refuse_unflown(file, item)
    before = points[-1]
    if _is_here(item):
        return _land_below(file, item, before)
    parent = Object()
    parent.line = item.line
    place = file.place(parent, f"item {item.number}: params 5,6", item.params[4], item.params[5])
    if before.place is not None and math.hypot(*Home(*before.place).to_local(place)) <= SAME_M:
        return _land_below(file, item, before)
    return [RoutePoint(place, before.height_m, _yaw(item), 0.0, item.line)]


def _land_below(file: _File, item: _Item, before: RoutePoint) -> List[RoutePoint]:
    """Return no further place; a heading must be that of the last waypoint, or 0, which is saved for none as well."""
    heading = item.params[3]
    if heading and _yaw(item) != before.yaw_rad:
        wrong = f"is {heading:g} (heading), below the last waypoint"
        right = "must be null, or the heading of that waypoint: give it there"
        file.refuse(item.line, f"item {item.number}: params 4", wrong, right)
    return []


def _yaw(item: _Item) -> Optional[float]:
    """Return a heading in degrees clockwise from north as radians counter-clockwise from east."""
    heading = item.params[3]
    if heading is None:
        return None
    turned = math.fmod(math.pi / 2 - math.radians(heading), 2 * math.pi)
    return math.atan2(math.sin(turned), math.cos(turned))


_WAYPOINT, _LOITER_TIME, _LAND, _TAKEOFF = 16, 19, 21, 22  # MAV_CMD
_SAID = {_TAKEOFF: "takeoff", _WAYPOINT: "waypoint", _LOITER_TIME: "loiter for a time", _LAND: "land"}
# parameters that must be 0 or null: index, what they ask for, why not
_UNFLOWN: Mapping[int, Sequence[Tuple[int, str, str]]] = {
    _WAYPOINT: (
        (1, "acceptance radius", "must be 0: acceptance_radius_m of missions.yaml counts"),
        (2, "pass by", "must be 0: every waypoint is flown to"),
    ),
    _LAND: (
        (0, "abort altitude", "must be 0: a landing of ours is never broken off for a climb"),
        (1, "precision landing", "must be 0: nobody looks for a mark on the ground"),
    ),
}
_COMMANDS: Mapping[int, Callable[[_File, _Item, Sequence[RoutePoint]], List[RoutePoint]]] = {
    _TAKEOFF: _takeoff,
    _WAYPOINT: _waypoint,
    _LOITER_TIME: _waypoint,
    _LAND: _land,
}


_FENCE_KEYS = ("circles", "polygons", "version", "breachReturn")


def _fence(file: _File, plan: Object) -> List[Area]:
    """Return the areas of a fence; none where nobody has drawn one, as the empty one of an old version."""
    fence = plan.get("geoFence")
    if fence is None:
        return []
    right = "must be a fence of polygons and circles, as QGroundControl saves it (version 2)"
    if not isinstance(fence, Object):
        file.refuse(plan.line, "geoFence", f"is {str(fence)[:40]}", right)
    for key, value in fence.items():
        if value and key not in _FENCE_KEYS:
            file.refuse(fence.line, "geoFence", f"has {key[:40]}", right)
    readers: Dict[str, Callable[[_File, Object], Area]] = {"polygons": _polygon, "circles": _circle}
    areas: List[Area] = []
    for key, read in readers.items():
        for each in file.part(fence, key, list, "a list of areas") if key in fence else ():
            if not isinstance(each, Object):
                file.refuse(fence.line, f"geoFence: {key}", "holds no object", "must be areas of a fence")
            areas.append(read(file, each))
    corners = sum(len(area.corners) for area in areas)
    if corners > MOST_CORNERS:
        right = f"must have at most {MOST_CORNERS} in all its areas: simplify them"
        file.refuse(fence.line, "geoFence", f"has {corners} corners and circles", right)
    return areas


def _polygon(file: _File, area: Object) -> Area:
    corners: List[Place] = []
    for corner in file.part(area, "polygon", list, "a list of corners"):
        if not isinstance(corner, list) or len(corner) < 2:  # noqa: PLR2004
            file.refuse(area.line, "polygon", "has a corner that is no place", "must be latitude and longitude")
        corners.append(file.place(area, "polygon", corner[0], corner[1]))
    return Area(tuple(corners), None, file.part(area, "inclusion", bool, "true or false"), area.line)


def _circle(file: _File, area: Object) -> Area:
    circle = file.part(area, "circle", Object, "centre and radius")
    centre = file.part(circle, "center", list, "latitude and longitude")
    if len(centre) < 2:  # noqa: PLR2004
        file.refuse(circle.line, "center", "is too short", "must be latitude and longitude")
    radius = file.number(circle, "radius", circle.get("radius"))
    if not radius > 0.0:
        file.refuse(circle.line, "radius", f"is {radius:g}", "must be above 0, in metres")
    place = file.place(circle, "center", centre[0], centre[1])
    return Area((place,), radius, file.part(area, "inclusion", bool, "true or false"), area.line)


# --- files ------------------------------------------------------------------------------------------------------------
# Any waypoint file: its name and its header say of which kind it is.


SUFFIXES = (".csv", ".plan")


def parse_file(text: str, file: str, mission: Said = Said()) -> Union[Trajectory, Route]:  # noqa: B008 - it cannot change
    """Read a whole waypoint file: in local metres, in latitude and longitude, or a plan of QGroundControl.

    `mission` is what its mission says of files that do not say it themselves.

    Raises:
        WaypointError: the first mistake in it, with line and column.
    """
    if file.endswith(".plan"):
        return parse_plan(text, file)
    parse = parse_route if is_global(lines_of(text)) else parse_trajectory
    return parse(text, file, mission)
