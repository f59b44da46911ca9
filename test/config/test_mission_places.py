"""Missions on the earth: homes, plans, fences, and who steers."""

from __future__ import annotations

import json

import pytest

from amaze_autonomy.config import load_configuration
from amaze_autonomy.missions import Controller, Home

GLOBAL = "latitude,longitude,relative_altitude,yaw_rad,holdtime\n47.00005,8.0,2,0,1\n"
RIGHT = "must stay inside the fence, and out of excluded areas, also between two waypoints"


@pytest.fixture
def mission(small, small_file):
    """Write the mission's own keys; return the folder."""

    def write(keys: str, name: str = "up.csv", text: str = ""):
        (small / "missions.yaml").write_text(small_file("missions.yaml").replace("up.csv", name) + keys)
        if text:
            (small / name).write_text(text)
        return small

    return write


def test_waypoints_in_latitude_and_longitude_lie_around_the_home_of_their_mission(mission):
    folder = mission("    home: {latitude_deg: 47.0, longitude_deg: 8.0}\n", text=GLOBAL)
    (plan,) = load_configuration(folder).plans
    assert plan.home == Home(47.0, 8.0)
    assert [(round(each.x_m, 2), round(each.y_m, 2)) for each in plan.trajectories[0].waypoints] == [(0.0, 5.56)]


def test_a_plan_brings_its_home_along(mission):
    document = {
        "fileType": "Plan",
        "version": 1,
        "geoFence": {
            "polygons": [{"polygon": [[46.9, 7.9], [46.9, 8.1], [47.1, 8.1], [47.1, 7.9]], "inclusion": True}],
            "circles": [],
        },
        "mission": {
            "plannedHomePosition": [47.0, 8.0, 400.0],
            "items": [
                {"type": "SimpleItem", "command": 16, "frame": 3, "params": [1, 0, 0, None, 47.00005, 8.0, 2]},
            ],
        },
    }
    (plan,) = load_configuration(mission("", "up.plan", json.dumps(document))).plans
    assert (plan.home, plan.trajectories[0].file) == (Home(47.0, 8.0), "up.plan")
    assert plan.total.length_m == pytest.approx(1.0 + (1.0 + 5.56**2) ** 0.5 + 2.0, abs=0.01)


@pytest.mark.parametrize("home, way_m", [([0, 0, 0], "5.27275e+06"), ([47.0, 8.1, 400.0], "7605.6")])
def test_a_planned_home_that_is_elsewhere_is_named_and_not_each_item(mistake, mission, home, way_m):
    document = json.loads(drawn((16, None, 47.00005, 8.0, 2)))
    document["mission"]["plannedHomePosition"] = home
    text = json.dumps(document, indent=1)
    mission("", "up.plan")
    assert mistake("up.plan", text) == (
        f"up.plan:4: plannedHomePosition: is {home[0]:g}, {home[1]:g}, {way_m} m from its nearest item; "
        "must be the place of the first takeoff, or its mission must have the key home"
    )
    folder = mission("    home: {latitude_deg: 47.0, longitude_deg: 8.0}\n", "up.plan", text)
    assert load_configuration(folder).plans[0].home == Home(47.0, 8.0), "that of the plan does not count"


def drawn(*items) -> str:
    """Return a plan of such items (command, heading, latitude, longitude, height), around 47, 8."""
    simple = [
        {"type": "SimpleItem", "command": command, "frame": 3, "params": [0, 0, 0, *rest]} for command, *rest in items
    ]
    mission = {"plannedHomePosition": [47.0, 8.0, 400.0], "items": simple}
    return json.dumps({"fileType": "Plan", "version": 1, "mission": mission}, indent=1)


OUT = drawn((22, None, 0, 0, 2), (16, None, 47.00008, 8.0, 2))
FURTHER = drawn((22, None, 0, 0, 3), (16, None, 47.00016, 8.0, 3), (21, None, 0, 0, 0))


@pytest.mark.parametrize(
    "touchdown, places",
    [("true", [[(0.0, 0.0), (0.0, 8.89)], [(0.0, 8.89), (0.0, 17.79)]]),
     ("false", [[(0.0, 0.0), (0.0, 8.89), (0.0, 17.79)]])],
)  # fmt: skip
def test_the_takeoff_of_a_second_plan_does_not_lead_back_to_home(mission, touchdown, places):
    folder = mission(f"    touchdown_between_files: {touchdown}\n", "up.plan, further.plan")
    (folder / "up.plan").write_text(OUT)
    (folder / "further.plan").write_text(FURTHER)
    (plan,) = load_configuration(folder).plans
    found = [[(round(each.x_m, 2), round(each.y_m, 2)) for each in one.waypoints] for one in plan.trajectories]
    assert found == places
    assert all(len(one.places) == len(one.waypoints) for one in plan.trajectories)


def test_a_takeoff_here_must_be_the_same_place_in_every_repetition(mistake, mission):
    mission("    repetitions: 2\n", "up.plan")
    assert mistake("up.plan", OUT) == (
        "up.plan:11: params 5,6: is here, which is 8.9 m away in further repetitions; "
        "must be the place of the takeoff, or the mission must end where it begins"
    )


def test_a_plan_that_ends_where_it_takes_off_may_be_repeated(mission):
    back = drawn((22, None, 0, 0, 2), (16, None, 47.00005, 8.0, 2), (21, None, 47.0, 8.0, 0))
    (plan,) = load_configuration(mission("    repetitions: 2\n", "up.plan", back)).plans
    assert len(plan.trajectories[0].waypoints) == 3


def test_without_a_home_there_are_no_places(mistake, mission):
    mission("", text=GLOBAL)
    assert mistake("up.csv", GLOBAL) == (
        "missions.yaml:4: missions.1.files.0: up.csv is in latitude and longitude; "
        "must have a home in its mission: the latitude_deg and longitude_deg of the first takeoff"
    )


def test_without_gps_there_are_no_places(mistake, mission):
    mission("    home: {latitude_deg: 47.0, longitude_deg: 8.0}\n    controller: offboard\n", text=GLOBAL)
    assert mistake("up.csv", GLOBAL) == (
        "missions.yaml:4: missions.1.files.0: up.csv is in latitude and longitude; "
        "must be in metres where the controller is offboard, which knows no place on the earth"
    )


def test_without_gps_nobody_would_look_at_a_home(mistake, small_file):
    text = small_file("missions.yaml") + "    controller: offboard\n    home: {latitude_deg: 47, longitude_deg: 8}\n"
    assert mistake("missions.yaml", text) == (
        "missions.yaml:6: missions.1.home: is given; "
        "must be left out where the controller is offboard, which knows no place on the earth"
    )


def test_who_steers_is_the_autopilot_unless_said_otherwise(mission):
    assert load_configuration(mission("")).plans[0].controller is Controller.MISSION
    assert load_configuration(mission("    controller: offboard\n")).plans[0].controller is Controller.OFFBOARD


def test_a_leg_that_leaves_the_fence_is_named(mistake, mission):
    mission("    fence_m: [[-5, -5], [5, -5], [5, 5], [-5, 5]]\n")
    text = "# frame: east_north\nx,y,z,yaw_rad,holdtime\n0,0,2,0,1\n0,6,2,0,1\n"
    assert mistake("up.csv", text) == f"up.csv:4: x,y: leaves the fence on the way there; {RIGHT}"


@pytest.mark.parametrize(
    "fence, message",
    [
        ("[[0, 0], [5, 0]]", "fence_m: has 2 corners; must have at least 3"),
        ("[[0, 0], [5, 0], [5, 5, 5]]", "fence_m.2: has 3 numbers; must be two numbers, metres east and north"),
        (
            "[[0, 0], [9, 9], [9, 0], [0, 9]]",
            "fence_m: crosses itself between corners 1 and 3; must go around one area",
        ),
    ],
)
def test_a_fence_that_is_none_is_named(mistake, small_file, fence, message):
    text = small_file("missions.yaml") + f"    fence_m: {fence}\n"
    assert mistake("missions.yaml", text) == f"missions.yaml:5: missions.1.{message}"


def test_the_planner_has_limits_of_its_own(small, small_file):
    (small / "missions.yaml").write_text("planner: {heading_tolerance_deg: 90}\n" + small_file("missions.yaml"))
    spec = load_configuration(small).planner
    assert spec.heading_tolerance_rad == pytest.approx(1.5707963)
    assert spec.transfer_limit_ns == 8_000_000_000


@pytest.mark.parametrize(
    "planner, message",
    [
        (
            "transfer_limit_s: 9.5",
            "transfer_limit_s: is 9.5; must be at most 9: the engine waits for 10 s (load_limit_s)",
        ),
        (
            "message_retry_s: 5",
            "message_retry_s: is 5; must be at most half of transfer_limit_s (8), or nothing is sent again",
        ),
        (
            "command_retry_s: 3",
            "command_retry_s: is 3; must be at most half of command_limit_s (4), or nothing is sent again",
        ),
    ],
)
def test_the_planner_gives_up_before_the_engine_and_repeats_before_it_gives_up(mistake, small_file, planner, message):
    text = f"planner: {{{planner}}}\n" + small_file("missions.yaml")
    assert mistake("missions.yaml", text) == f"missions.yaml:1: planner.{message}"
