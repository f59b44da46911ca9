"""Plans of QGroundControl: what is taken, and the one mistake that is named."""

from __future__ import annotations

import copy
import json
from math import pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from amaze_autonomy.missions import (
    Area,
    Home,
    Place,
    RoutePoint,
    WaypointError,
    localize_fence,
    parse_file,
)

HOME = [47.0, 8.0, 400.0]


def item(command: int, latitude: object, longitude: object, height: float, hold: float = 0.0, heading=None, **more):
    params = [hold, 0, 0, heading, latitude, longitude, height]
    return {"type": "SimpleItem", "command": command, "frame": 3, "params": params, "autoContinue": True, **more}


def plan(*items: object, fence: object = None) -> dict:
    return {
        "fileType": "Plan",
        "geoFence": fence or {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {"items": list(items), "plannedHomePosition": HOME, "version": 2, "firmwareType": 12},
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }


GOOD = plan(
    item(22, 47.0, 8.0, 3.0),
    item(16, 47.0001, 8.0, 5.0, hold=2.0, heading=90.0),
    item(19, 47.0001, 8.0001, 5.0, hold=4.0),
    item(21, 47.0, 8.0001, 0.0),
)


def read(document: object):
    return parse_file(json.dumps(document, indent=4), "a.plan")


def test_takeoff_waypoints_and_landing_are_places_to_fly_to():
    route = read(GOOD)
    assert route.home == Home(47.0, 8.0)
    assert [each._replace() if hasattr(each, "_replace") else each for each in route.points] == [
        RoutePoint(Place(47.0, 8.0), 3.0, None, 0.0, route.points[0].line, takeoff=True),
        RoutePoint(Place(47.0001, 8.0), 5.0, 0.0, 2.0, route.points[1].line),
        RoutePoint(Place(47.0001, 8.0001), 5.0, None, 4.0, route.points[2].line),
        RoutePoint(Place(47.0, 8.0001), 5.0, None, 0.0, route.points[3].line),  # above where it lands
    ]


def test_every_point_knows_its_line():
    lines, points = json.dumps(GOOD, indent=4).split("\n"), read(GOOD).points
    assert len({point.line for point in points}) == len(points) > 1
    for point in points:
        assert lines[point.line - 1].strip() == "{"
        assert any("SimpleItem" in line for line in lines[point.line : point.line + 3])


@pytest.mark.parametrize("heading, yaw", [(0.0, pi / 2), (90.0, 0.0), (180.0, -pi / 2), (270.0, pi), (720.0, pi / 2)])
def test_headings_are_clockwise_from_north(heading, yaw):
    (point,) = read(plan(item(16, 47.0, 8.0, 5.0, heading=heading))).points
    assert abs(point.yaw_rad) == pytest.approx(abs(yaw), abs=1e-12)
    assert sin(point.yaw_rad) == pytest.approx(sin(yaw), abs=1e-12), "pi and -pi are one"


@pytest.mark.parametrize("here", [(None, None), (0, 0), (0.0, None)])
def test_a_takeoff_and_a_landing_without_a_place_are_here(here):
    route = read(plan(item(22, *here, 3.0), item(16, 47.0001, 8.0, 5.0), item(21, *here, 0.0)))
    assert [point.place for point in route.points] == [None, Place(47.0001, 8.0)]
    assert [point.takeoff for point in route.points] == [True, False]


@pytest.mark.parametrize("here", [(None, None), (47.0001, 8.0)])
@pytest.mark.parametrize("heading, before", [(None, None), (0, None), (0, 90.0), (90.0, 90.0), (450.0, 90.0)])
def test_below_the_last_waypoint_a_landing_may_have_the_heading_that_is_flown_or_what_is_saved_for_none(
    here, heading, before
):
    route = read(plan(item(16, 47.0001, 8.0, 5.0, heading=before), item(21, *here, 0.0, hold=None, heading=heading)))
    assert [point.place for point in route.points] == [Place(47.0001, 8.0)]


def test_elsewhere_a_landing_has_a_heading_of_its_own():
    route = read(plan(item(16, 47.0, 8.0, 5.0), item(21, 47.0001, 8.0, 0.0, heading=90.0)))
    assert [point.yaw_rad for point in route.points] == [None, 0.0]


def test_a_place_on_the_meridian_of_greenwich_is_one():
    assert read(plan(item(22, 51.5, 0, 3.0))).points[0].place == Place(51.5, 0.0)


def test_a_plan_of_a_takeoff_here_and_a_landing_elsewhere_flies_there():
    route = read(plan(item(22, None, None, 3.0), item(21, 47.0001, 8.0, 0.0)))
    assert [(point.place, point.height_m) for point in route.points] == [(None, 3.0), (Place(47.0001, 8.0), 3.0)]


def test_the_fence_that_was_drawn_counts():
    fence = {
        "circles": [{"circle": {"center": [47.0, 8.0], "radius": 20.0}, "inclusion": False, "version": 1}],
        "polygons": [{"polygon": [[46.9, 7.9], [46.9, 8.1], [47.1, 8.0]], "inclusion": True, "version": 1}],
        "version": 2,
    }
    route = read({**GOOD, "geoFence": fence})
    assert [each.stay_in for each in route.fence] == [True, False]
    assert route.fence[1] == Area((Place(47.0, 8.0),), 20.0, stay_in=False, line=route.fence[1].line)
    local = localize_fence(route, Home(47.0, 8.0))
    assert local.problem((100.0, 0.0), (200.0, 0.0)) == ""
    assert local.problem((0.0, 0.0), (200.0, 0.0)) == "enters an excluded area on the way there"


def test_what_a_multicopter_has_not_got_is_not_looked_at():
    loiter = item(19, 47.0001, 8.0, 5.0)
    loiter["params"][1:3] = [1, 50.0]  # turns before it leaves, on the circle of a fixed wing
    without = item(16, 47.0001, 8.0, 5.0)
    without["params"][1] = None
    del without["autoContinue"]
    assert len(read(plan(loiter, without)).points) == 2


def _with(change):
    document = copy.deepcopy(GOOD)
    change(document)
    return document


SQUARE = {"polygon": [[46.9, 7.9], [46.9, 8.1], [47.1, 8.0]], "inclusion": True, "version": 1}
CIRCLE = {"circle": {"center": [47.0, 8.0], "radius": 9.0}, "inclusion": True, "version": 1}
FENCE = "must be a fence of polygons and circles, as QGroundControl saves it (version 2)"


@pytest.mark.parametrize(
    "fence",
    [None, {}, {"polygon": [], "version": 1}, {"circles": [], "polygons": [], "version": 2, "breachReturn": HOME}],
)
def test_a_plan_in_which_no_fence_was_drawn_has_none_of_whatever_version(fence):
    assert read({**GOOD, "geoFence": fence}).fence == ()
    assert read({key: value for key, value in GOOD.items() if key != "geoFence"}).fence == ()


@pytest.mark.parametrize("rally", [None, {}, {"points": [], "version": 2}, {"version": 1, "points": None}])
def test_a_plan_without_rally_points_is_flown(rally):
    assert len(read({**GOOD, "rallyPoints": rally}).points) == 4
    assert len(read({key: value for key, value in GOOD.items() if key != "rallyPoints"}).points) == 4


RALLY = "must have none: nobody flies to them, so remove them in QGroundControl and save the plan again"
LAST = "must be null, or the heading of that waypoint: give it there"
TURNED = f"item 4: params 4: is 90 (heading), below the last waypoint; {LAST}"
EARLY = "item 4: lands before the end; must be the last item"
COMMANDS = "must be one of 22 (takeoff), 16 (waypoint), 19 (loiter for a time), 21 (land)"


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda d: d.update(fileType="Mission"), "fileType: is Mission; must be Plan, of version 1"),
        (lambda d: d.pop("mission"), "mission: is missing; must be the mission"),
        (lambda d: d["mission"].update(items={}), "items: is {}; must be a list of items"),
        (lambda d: d["mission"].update(items=[]), "items: has no waypoints; must have at least one item of command 16"),
        (lambda d: d["mission"].pop("plannedHomePosition"),
         "plannedHomePosition: is missing; must be latitude, longitude and altitude of home"),
        (lambda d: d["mission"]["items"].insert(1, item(178, None, None, 0.0)), f"item 2: is command 178; {COMMANDS}"),
        (lambda d: d["mission"]["items"].append(item(20, 0, 0, 0.0)), EARLY),
        (lambda d: d["mission"]["items"].append(item(22, 0, 0, 0.0)), EARLY),
        (lambda d: d["mission"]["items"].reverse(), EARLY.replace("4", "1")),
        (lambda d: d["mission"]["items"].insert(1, d["mission"]["items"][0]),
         "item 2: takes off in flight; must be the first item"),
        (lambda d: d["mission"]["items"][1].update(frame=0),
         "item 2: frame: is 0; must be 3, metres above the takeoff (AltitudeMode: relative)"),
        (lambda d: d["mission"]["items"][1].update(type="ComplexItem", complexItemType="survey"),
         "item 2: is of the type survey; must be a simple item, e.g. a waypoint"),
        (lambda d: d["mission"]["items"][1].update(params=[0, 0]), "item 2: params: has 2 values; must have seven"),
        (lambda d: d["mission"]["items"][1]["params"].__setitem__(4, "47"),
         "item 2: params: is 47; must be a finite number"),
        (lambda d: d["mission"]["items"][1]["params"].__setitem__(4, None),
         "item 2: params 5: is null; must be a number"),
        (lambda d: d["mission"]["items"][1]["params"].__setitem__(4, 147.0),
         "item 2: params 5,6: is 147, 8; must be a latitude and a longitude in degrees"),
        (lambda d: d["mission"]["items"][1]["params"].__setitem__(2, 5.0),
         "item 2: params 3: is 5 (pass by); must be 0: every waypoint is flown to"),
        (lambda d: d["mission"]["items"][1]["params"].__setitem__(1, 3.0),
         "item 2: params 2: is 3 (acceptance radius); must be 0: acceptance_radius_m of missions.yaml counts"),
        (lambda d: d["mission"]["items"][3]["params"].__setitem__(0, 25.0),
         "item 4: params 1: is 25 (abort altitude); must be 0: a landing of ours is never broken off for a climb"),
        (lambda d: d["mission"]["items"][3]["params"].__setitem__(1, 2.0),
         "item 4: params 2: is 2 (precision landing); must be 0: nobody looks for a mark on the ground"),
        (lambda d: d["mission"]["items"][3]["params"].__setitem__(slice(3, 6), [90.0, 47.0001, 8.0001]), TURNED),
        (lambda d: d["mission"]["items"][3]["params"].__setitem__(slice(3, 6), [90.0, 0, 0]), TURNED),
        (lambda d: d["mission"]["items"][1].update(autoContinue=False),
         "item 2: autoContinue: is False; must be true: nobody is asked between two items"),
        (lambda d: d["mission"]["items"][0].update(autoContinue=0),
         "item 1: autoContinue: is 0; must be true: nobody is asked between two items"),
        (lambda d: d["mission"]["items"].__setitem__(1, 5), "item 2: is no object; must be a mission item"),
        (lambda d: d["geoFence"].update(polygons=[{"polygon": [[47.0]], "inclusion": True}]),
         "polygon: has a corner that is no place; must be latitude and longitude"),
        (lambda d: d["geoFence"].update(circles=[{"circle": {"center": [47.0, 8.0], "radius": 0}, "inclusion": True}]),
         "radius: is 0; must be above 0, in metres"),
        (lambda d: d.update(geoFence=[SQUARE]), f"geoFence: is {str([SQUARE])[:40]}; {FENCE}"),
        (lambda d: d.update(geoFence=False), f"geoFence: is False; {FENCE}"),
        (lambda d: d.update(geoFence={"polygon": SQUARE["polygon"], "version": 1}), f"geoFence: has polygon; {FENCE}"),
        (lambda d: d["geoFence"].update(Polygons=[SQUARE]), f"geoFence: has Polygons; {FENCE}"),
        (lambda d: d["geoFence"].update(polygons=[SQUARE] * 166, circles=[CIRCLE] * 3),
         "geoFence: has 501 corners and circles; must have at most 500 in all its areas: simplify them"),
        (lambda d: d["rallyPoints"].update(points=[[47.1, 14.0, 50.0]]), f"rallyPoints: has points; {RALLY}"),
        (lambda d: d.update(rallyPoints=[[47.1, 14.0, 50.0]]), f"rallyPoints: is [[47.1, 14.0, 50.0]]; {RALLY}"),
        (lambda d: d.update(rallyPoints={"Points": [[47.1, 14.0, 50.0]]}), f"rallyPoints: has Points; {RALLY}"),
    ],
)  # fmt: skip
def test_a_mistake_is_named(change, message):
    with pytest.raises(WaypointError) as caught:
        read(_with(change))
    error = caught.value
    assert ": ".join(part for part in (error.column, f"{error.wrong}; {error.right}") if part) == message
    assert error.line > 0


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "a.plan:1: is not JSON: Expecting value; must be a whole plan"),
        ('{"fileType": "Plan",\n\n "a": }', "a.plan:3: is not JSON: Expecting value; must be a whole plan"),
        ("[]", "a.plan:1: is no JSON object; must be a plan as QGroundControl saves it"),
        ('{"a": 1, "a": 2}', "a.plan: has the key 'a' twice; must be a plan as QGroundControl saves it"),
        ('{"a": NaN}', "a.plan: holds NaN, which is no number; must be a plan as QGroundControl saves it"),
        ('{"a": "' + "[" * 101 + '"', "a.plan:1: is not JSON: Expecting ',' delimiter; must be a whole plan"),
        ("[" * 101, "a.plan: is nested too deeply; must be a plan as QGroundControl saves it"),
        ("[" * 100000, "a.plan: is nested too deeply; must be a plan as QGroundControl saves it"),
    ],
    ids=range(8),
)
def test_what_is_no_json_is_named_with_its_line(text, message):
    with pytest.raises(WaypointError) as caught:
        parse_file(text, "a.plan")
    assert str(caught.value) == message


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@settings(max_examples=150)
@given(st.data())
def test_any_change_of_a_plan_is_a_route_or_one_mistake(data):
    document = copy.deepcopy(GOOD)
    where = data.draw(st.sampled_from(["mission", "geoFence"]))
    part = document[where]
    key = data.draw(st.sampled_from(sorted(part)))
    while isinstance(part[key], (dict, list)) and part[key] and data.draw(st.booleans()):
        part = part[key]
        key = data.draw(st.sampled_from(sorted(part) if isinstance(part, dict) else range(len(part))))
    part[key] = data.draw(ANYTHING)
    try:
        assert read(document).points
    except WaypointError as error:
        assert error.right  # noqa: PT017 (either is good)
