"""Every row of the two tables of DESIGN.md section 4 in every phase, and every code x phase cell."""

from __future__ import annotations

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_peers import COMPONENTS as LISTED
from engine_peers import SHIPPED, S
from engine_story import Story
from expected_decisions import AIRBORNE, BEFORE_LIFT_OFF, COMPONENTS, ON_THE_GROUND, SEVERITIES, VERBS

from amaze_autonomy.engine import failsafe, rules
from amaze_autonomy.engine.events import Mission
from amaze_autonomy.engine.rules import Code, Severity

IN_FLIGHT = {**AIRBORNE, **BEFORE_LIFT_OFF}
CODES = (1, 2, 4, 8, 16)
ROW_OF_CODE = {1: "low", 2: "low", 4: "moderate", 8: "high", 16: "highest"}
WAITING = [name for name, row in COMPONENTS.items() if row.action == "wait"]
HOLDING_PLACES = ["TAKEOFF climbing", "MISSION flying"]


# --- the tables themselves --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SEVERITIES)
def test_severity_table(name):
    row = rules.SEVERITIES[Severity(name)]
    fallback = row.fallback.name.lower() if row.fallback is not None else None
    assert (int(row.code), int(row.code_given_up), row.action.name.lower(), fallback) == SEVERITIES[name]


def test_severity_table_is_complete():
    assert [s.value for s in rules.SEVERITIES] == list(SEVERITIES)


@pytest.mark.parametrize("name, code", VERBS)
def test_verb_of_every_severity_and_code(name, code):
    action = rules.action_of(Severity(name), Code(code))
    assert (action.name.lower() if action is not None else None) == VERBS[name, code]


@pytest.mark.parametrize("code", CODES)
def test_an_unlisted_component_gets_the_row_of_its_code(code):
    assert (
        failsafe.severity_of("unheard of", Code(code), at("MISSION flying").state, SHIPPED).value == ROW_OF_CODE[code]
    )


def test_stories_fly_with_the_decision_table_that_ships():
    ours = {rule.name: (rule.group, rule.restart, rule.severity.value, rule.wait_limit_ns / S) for rule in LISTED}
    assert ours == {name: (row.group, row.restart, row.severity, row.wait_s) for name, row in COMPONENTS.items()}


def test_each_component_fails_with_the_code_of_its_severity():
    for name, row in COMPONENTS.items():
        assert (row.code, row.action, row.fallback) == (
            SEVERITIES[row.severity].code,
            SEVERITIES[row.severity].action,
            SEVERITIES[row.severity].fallback,
        ), name


@pytest.mark.parametrize("name", [name for name, row in COMPONENTS.items() if row.group == "px4"])
def test_a_px4_sensor_with_a_restart_is_refused_by_the_code(name):
    with pytest.raises(ValueError, match="never restarted"):
        rules.ComponentRule(name, "px4", restart=True, severity=Severity.LOW, wait_limit_ns=0)


# --- every component in every phase -----------------------------------------------------------------------------------


@pytest.mark.parametrize("place", IN_FLIGHT)
@pytest.mark.parametrize("name", COMPONENTS)
def test_component_fails_in_flight(name, place):
    story, row = at(place), COMPONENTS[name]
    expected = IN_FLIGHT[place][row.action]
    story.fail(name, row.code)
    assert (*story.place, tuple(story.motions)) == expected
    if story.motions:
        first = story.since[0]
        assert story.motions[0] == expected.motions[0]
        assert type(first).__name__ == "MissionCommand", "the command comes before messages and decisions"


@pytest.mark.parametrize("place", ON_THE_GROUND)
@pytest.mark.parametrize("name", COMPONENTS)
def test_component_fails_on_the_ground(name, place):
    story, row = at(place), COMPONENTS[name]
    story.fail(name, row.code)
    assert (story.place[0], story.motions) == (ON_THE_GROUND[place][row.code], [])


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("place", IN_FLIGHT)
@pytest.mark.parametrize("listed", [True, False])
def test_every_code_in_every_phase_of_flight(place, code, listed):
    """A high component (the LRF), and one that nobody listed."""
    story, name = at(place), "lrf" if listed else "unheard of"
    action = VERBS["high" if listed else ROW_OF_CODE[code], code]
    expected = IN_FLIGHT[place][action or "continue"]
    story.fail(name, code)
    assert (*story.place, tuple(story.motions)) == expected


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("place", ON_THE_GROUND)
@pytest.mark.parametrize("name", ["lrf", "unheard of"])
def test_every_code_in_every_phase_on_the_ground(place, code, name):
    story = at(place)
    story.fail(name, code)
    assert (story.place[0], story.motions) == (ON_THE_GROUND[place][code], [])


def test_no_phase_is_without_its_cells():
    assert sorted([*IN_FLIGHT, *ON_THE_GROUND]) == sorted(BEGINNINGS)
    for cells in IN_FLIGHT.values():
        assert sorted(cells) == ["continue", "land", "wait"]
    for codes in ON_THE_GROUND.values():
        assert sorted(codes) == [1, 2, 4, 8, 16]


@pytest.mark.parametrize("place", HOLDING_PLACES)
@pytest.mark.parametrize("name, code", VERBS)
def test_every_severity_and_code_in_flight(name, code, place):
    component = next(c for c, row in COMPONENTS.items() if row.severity == name)
    story = at(place)
    story.fail(component, code)
    assert (*story.place, tuple(story.motions)) == AIRBORNE[place][VERBS[name, code] or "continue"]


# --- the fallback, at the limit ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", HOLDING_PLACES)
@pytest.mark.parametrize("name", WAITING)
def test_not_back_in_time_the_second_verb(name, place):
    story, row = at(place), COMPONENTS[name]
    story.fail(name, row.code)
    story.after_ns(round(row.wait_s * S) - 1).expect("HOLD", "holding")
    story.look().after_ns(1)
    if row.fallback == "land":
        story.expect("LAND")
        assert story.motions == ["LAND"]
        story.until("DATA_CLEANUP")
    else:
        story.expect("HOLD", "resuming")
        assert story.motions == ["RESUME"]
        assert story.told == ["flown_without", "resuming"]
        story.until("MISSION", "flying").until("MISSION_ENDED")
        assert story.state.session.result.value == "COMPLETE"


@pytest.mark.parametrize("place", HOLDING_PLACES)
@pytest.mark.parametrize("name", WAITING)
def test_back_just_before_the_limit_goes_on(name, place):
    story, row = at(place), COMPONENTS[name]
    story.fail(name, row.code)
    story.after_ns(round(row.wait_s * S) - 1).look()
    story.back(name).expect("HOLD", "resuming")
    assert story.motions == ["RESUME"]
    state, _, step = place.partition(" ")
    story.until(state, step).until("MISSION_ENDED")
    assert (story.motions, story.state.session.result.value) == (["RESUME"], "COMPLETE")


@pytest.mark.parametrize("name", WAITING)
def test_back_at_the_very_limit_is_back(name):
    """The event that says so comes at the nanosecond of the limit, before the tick."""
    story, row = at("MISSION flying"), COMPONENTS[name]
    story.fail(name, row.code)
    story.after_ns(round(row.wait_s * S) - 1).look()
    story.now += 1
    story.back(name).expect("HOLD", "resuming")
    assert story.motions == ["RESUME"]


@pytest.mark.parametrize("name", WAITING)
def test_back_after_the_limit_is_too_late(name):
    story, row = at("MISSION flying"), COMPONENTS[name]
    story.fail(name, row.code)
    story.after_ns(round(row.wait_s * S) + 1).look()
    story.back(name)
    if row.fallback == "land":
        story.expect("LAND")
        story.until("DATA_CLEANUP")
        assert not {"RESUME", "HOLD"} & set(story.motions)
    else:
        story.until("MISSION_ENDED")
        assert story.motions == []
        assert story.state.session.result.value == "COMPLETE"


@pytest.mark.parametrize("name", WAITING)
@pytest.mark.parametrize("place", [*HOLDING_PLACES, "HOLD confirming", "HOLD holding", "HOLD resuming"])
def test_given_up_ends_the_wait_at_once(name, place):
    story, row = at(place), COMPONENTS[name]
    story.fail(name, row.code, "trying")
    story.look()
    story.fail(name, SEVERITIES[row.severity].code_given_up, "given_up")
    if row.fallback == "land":
        assert (story.place[0], story.motions) == ("LAND", ["LAND"])
    else:
        assert "LAND" not in story.motions
        assert story.failure(name).action.name == "CONTINUE"
        assert story.told[0] == "flown_without"


def test_given_up_at_code_8_lands_too():
    story = at("MISSION flying")
    story.fail("lrf", 8, "given_up")
    assert (story.place[0], story.motions) == ("LAND", ["LAND"])


def test_highest_lands_even_at_code_4():
    story = at("MISSION flying")
    story.fail("imu", 4)
    assert (story.place[0], story.motions) == ("LAND", ["LAND"])


def test_a_mission_may_judge_a_component_otherwise():
    mission = Mission(id="1", severities=(("gps", Severity.HIGHEST), ("lrf", Severity.LOW)))
    story = Story(SHIPPED, mission).start().after(0.5).select().until("MISSION", "flying").look()
    story.fail("lrf", 8).expect("MISSION", "flying")
    assert story.motions == []
    story.fail("gps", 4)
    assert (story.place[0], story.motions) == ("LAND", ["LAND"])


def test_a_mission_that_judges_a_component_highest_lands_at_once():
    mission = Mission(id="1", severities=(("lrf", Severity.HIGHEST),))
    story = Story(SHIPPED, mission).start().after(0.5).select().until("MISSION", "flying").look()
    story.fail("lrf", 8)
    assert (story.place[0], story.motions) == ("LAND", ["LAND"])
