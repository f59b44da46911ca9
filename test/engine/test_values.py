"""Impossible values are refused when they are made, with a name for what is wrong; unknown ones become None."""

from __future__ import annotations

import re
from dataclasses import FrozenInstanceError, is_dataclass
from importlib import import_module
from math import inf, nan
from pathlib import Path
from pkgutil import iter_modules

import pytest
from engine_beginnings import at
from engine_peers import MISSION, SHIPPED, S
from engine_story import Story

from amaze_autonomy import engine, monitoring
from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import AutopilotLand, Level
from amaze_autonomy.engine.events import Check, Mission, Verdict
from amaze_autonomy.engine.rules import Action, Code, ComponentRule, Limits, Restart, Rules, Severity
from amaze_autonomy.engine.state import Asked, DataResult, EngineState, OutreachKind, Result, State, Step


@pytest.mark.parametrize("t_ns", [-1, 1.5, None, "0"])
def test_an_event_without_a_time_cannot_exist(t_ns):
    with pytest.raises(ev.InvalidEventError, match=r"Tick\.t_ns is .*, must be a whole number") as error:
        ev.Tick(t_ns=t_ns)
    assert (error.value.event, error.value.field, error.value.value) == ("Tick", "t_ns", t_ns)


def test_a_selection_without_a_mission_cannot_exist():
    with pytest.raises(ev.InvalidEventError, match="at least one mission"):
        ev.MissionSelected(t_ns=0, missions=())


@pytest.mark.parametrize(
    "kind, message",
    [
        (ev.MissionPhase, "MissionStatus"),
        (ev.RecordingPhase, "RecordingStatus"),
        (ev.VehicleLanded, "AutopilotStatus"),
        (ev.Landed, "Landed"),
    ],
)
def test_the_numbers_of_a_word_are_those_of_its_message(kind, message):
    text = (Path(__file__).parents[2] / "msg" / f"{message}.msg").read_text(encoding="utf-8")
    said = {name: int(number) for name, number in re.findall(r"^uint8 (\w+)=(\d+)", text, re.MULTILINE)}
    ours = {name: member.value for name, member in kind.__members__.items()}
    assert ours == {name: number for name, number in said.items() if not name.startswith("SENSOR_")}
    assert len(ours) == len(kind), "no two words for one number"


def test_an_engine_that_has_heard_nothing_believes_nothing():
    fresh = {name: value for name, value in vars(EngineState()).items() if value}
    parts = {name: value for name, value in fresh.items() if is_dataclass(value)}
    assert {name: fresh[name] for name in fresh if name not in parts} == {
        "state": State.MISSION_INPUT,
        "step": Step.NONE,
        "next_id": 1,
        "label": "session",
    }
    assert {name: {field: said for field, said in vars(part).items() if said} for name, part in parts.items()} == {
        "said": {"level": Level.INFO},
        "shown": {"level": Level.INFO},
        "session": {"result": Result.NONE, "data_result": DataResult.NONE, "outreach": OutreachKind.NONE},
        "preflight": {"load": Asked()},
        "flight": {"interrupted": State.MISSION, "motion": Asked()},
        "landing": {},
        "recording": {"request": Asked()},
        "vehicle": {},
        "peers": {},
    }
    assert not any(vars(Asked()).values())


def test_what_a_planner_does_not_say_is_nothing():
    said = ev.MissionStatus(t_ns=1, session_id="s", mission_id="m", phase=ev.MissionPhase.IDLE)
    assert (said.waypoint, said.waypoints, said.file_index, said.repetition, said.age_ns) == (0, 0, 0, 0, 0)
    assert (said.distance_left_m, said.time_left_s, said.message) == (None, None, "")


@pytest.mark.parametrize("package, at_least", [(engine, 30), (monitoring, 10)], ids=["engine", "monitoring"])
def test_no_value_can_be_changed_once_it_is_made(package, at_least):
    modules = [import_module(f"{package.__name__}.{found.name}") for found in iter_modules(package.__path__)]
    seen = {each for module in modules for each in vars(module).values() if isinstance(each, type)}
    values = [each for each in seen if is_dataclass(each)]
    assert len(values) >= at_least
    assert [each.__name__ for each in values if not each.__dataclass_params__.frozen] == []


def test_events_and_commands_take_keywords_only_and_do_not_change():
    with pytest.raises(TypeError, match="keyword arguments only"):
        ev.Tick(0)
    with pytest.raises(TypeError, match="keyword arguments only"):
        AutopilotLand(1, 2)
    with pytest.raises(FrozenInstanceError):
        ev.Tick(t_ns=0).t_ns = 1
    with pytest.raises(FrozenInstanceError):
        EngineState().t_ns = 1


STATUSES = (
    ev.AutopilotStatus(t_ns=3, armed=None, landed=ev.VehicleLanded.IN_AIR, battery_age_s=-0.1, height_m=1.0, age_ns=2),
    ev.LandedStatus(t_ns=3, landed=ev.Landed.AIRBORNE, distance_m=0.5, reason="seen"),
    ev.MissionStatus(t_ns=3, session_id="s", mission_id="1", phase=ev.MissionPhase.FLYING, time_left_s=4.0),
    ev.RecordingStatus(t_ns=3, session_id="s", phase=ev.RecordingPhase.RECORDING, progress=0.25),
    ev.WatchdogAction(t_ns=3, sequence=1, loop_counter=2, code=Code.HOLD),
)


@pytest.mark.parametrize("status", STATUSES, ids=lambda status: type(status).__name__)
def test_an_event_that_is_made_of_all_its_fields_is_what_its_constructor_makes(status):
    kind, said = type(status), dict(vars(status))
    assert (ev.made(kind, **said), vars(ev.made(kind, **said))) == (status, said)
    strange = {name: nan if isinstance(value, float) else value for name, value in said.items()}
    assert vars(ev.made(kind, **strange)) == vars(kind(**strange))
    with pytest.raises(ev.InvalidEventError, match="must be a whole number"):
        ev.made(kind, **{**said, "t_ns": -1})


def test_an_event_is_made_of_all_its_fields():
    with pytest.raises(
        TypeError, match="LandedStatus is made of all its fields: t_ns, landed, distance_m, reason, age"
    ):
        ev.made(ev.LandedStatus, t_ns=3, landed=ev.Landed.AIRBORNE)
    with pytest.raises(TypeError, match="missing 1 required"):
        ev.made(ev.LandedStatus, t_ns=3)
    with pytest.raises(TypeError, match="unexpected keyword argument 'distance_cm'"):
        ev.made(ev.LandedStatus, t_ns=3, landed=ev.Landed.AIRBORNE, distance_cm=50.0, reason="", age_ns=0)


@pytest.mark.parametrize("value", [nan, inf, -inf, None])
def test_unknown_is_none_in_every_field_of_a_status(value):
    said = {
        "link_age_s": value,
        "height_m": value,
        "position_x_m": value,
        "position_y_m": value,
        "vertical_speed_m_s": value,
        "battery_fraction": value,
        "battery_voltage_v": value,
        "battery_age_s": value,
    }
    status = ev.AutopilotStatus(t_ns=0, armed=True, landed=ev.VehicleLanded.IN_AIR, **said)
    assert {name: getattr(status, name) for name in said} == dict.fromkeys(said)
    assert Check(name="c", verdict=Verdict.PASS, value=value, limit=value, age_s=value).value is None
    assert ev.LandedStatus(t_ns=0, landed=ev.Landed.UNKNOWN, distance_m=value).distance_m is None
    assert ev.RecordingStatus(t_ns=0, session_id="s", phase=ev.RecordingPhase.IDLE, progress=value).progress is None


@pytest.mark.parametrize("age, kept", [(0.0, 0.0), (-0.1, 0.0), (-0.3, None), (3.0, 3.0), (1e300, None)])
def test_an_age_is_past(age, kept):
    status = ev.AutopilotStatus(t_ns=0, armed=True, landed=ev.VehicleLanded.IN_AIR, link_age_s=age, battery_age_s=age)
    assert (status.link_age_s, status.battery_age_s) == (kept, kept)


@pytest.mark.parametrize(
    "fields",
    [{"id": ""}, {"files": 0}, {"repetitions": 0}, {"battery_needed_fraction": 1.1}, {"battery_needed_fraction": nan}],
)
def test_an_impossible_mission_cannot_exist(fields):
    with pytest.raises(ValueError, match="mission"):
        Mission(**{"id": "1", **fields})


@pytest.mark.parametrize("value", [0, -1, nan])
def test_a_limit_must_be_above_zero(value):
    with pytest.raises(ValueError, match="check_max_age_ns"):
        Limits(check_max_age_ns=value)


def test_a_component_is_listed_once_and_its_wait_is_not_negative():
    rule = ComponentRule("gps", "px4", restart=False, severity=Severity.LOW, wait_limit_ns=0)
    with pytest.raises(ValueError, match="gps is listed twice"):
        Rules(components=(rule, rule))
    with pytest.raises(ValueError, match="gps: wait_limit_ns is -1"):
        ComponentRule("gps", "px4", restart=False, severity=Severity.LOW, wait_limit_ns=-1)


def test_codes_and_verbs_are_ordered_the_worst_wins():
    assert sorted(Code) == [Code.NOMINAL, Code.NON_CRITICAL, Code.INCONVENIENT, Code.HOLD, Code.ABORT]
    assert [int(code) for code in Code] == [1, 2, 4, 8, 16]
    assert Action.CONTINUE < Action.WAIT < Action.LAND < Action.PILOT
    assert [restart.value for restart in Restart] == ["none", "trying", "given_up"]


# --- and what is left of the engine's own doubts ----------------------------------------------------------------------


def test_a_stale_info_message_says_nothing():
    story = at("READY")
    gps = (ev.ComponentStatus("gps", Code.NON_CRITICAL),)
    story.feed(ev.WatchdogInfo, sequence=1, changed=("gps",), components=gps, age_ns=S + 1)
    story.expect("READY")


def test_no_takeoff_with_a_battery_that_the_autopilot_never_told():
    """The battery check may pass by another route; a flight without a level would be landed after its age limit."""
    story = Story(SHIPPED, MISSION)
    story.vehicle.says["battery_fraction"] = None
    story.start().after(0.5).select().until("OUTREACH", limit_s=40.0)
    assert story.motions == []
    assert "battery" in story.state.shown.text


def test_a_mission_that_is_selected_after_the_process_was_told_to_end_does_not_take_off():
    story = at("MISSION_INPUT")
    story.feed(ev.Shutdown)
    story.select().until("OUTREACH", limit_s=40.0)
    assert story.motions == []
    assert "told to end" in story.state.shown.text


def test_a_mode_that_was_foreign_once_is_still_foreign_in_the_next_status():
    story = at("MISSION flying")
    story.say(mode="POSCTL").until("PILOT", limit_s=0.5)
    story.report()
    story.expect("PILOT")
