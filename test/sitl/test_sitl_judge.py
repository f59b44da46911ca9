"""The judge of the flights with real autopilots: what it must call bad, made by hand."""

from __future__ import annotations

import pytest
from sitl_judge import Journal, _compared, _expected, _measured, _rules, read_journal
from sitl_wire import Order, Shown, Wire

ARMED = [Shown(0.0, False, "AUTO.LOITER"), Shown(10.0, True, "AUTO.MISSION"), Shown(20.4, True, "AUTO.LAND")]
FLOWN = (*ARMED, Shown(30.0, False, "AUTO.LAND"))
LANDS = Order(20.1, "planner", "AUTO.LAND", 2.0)


def wire(*orders, shown=FLOWN, heights=((9.0, 0.0), (15.0, 2.5), (30.0, 0.0))):
    return Wire(tuple(shown), (), orders, heights)


def journal(*states, code_16_s=None, sent=()):
    rows = [(t_s, {"after": state, "step": "", "commands": []}) for t_s, state in states]
    rows += [(t_s, {"after": "", "step": "", "commands": [f"MissionCommand({action})#1"]}) for t_s, action in sent]
    return Journal(states, tuple(rows), code_16_s, "")


FLIGHT = ((10.0, "TAKEOFF"), (12.0, "MISSION"))


def test_a_landing_by_us_is_good():
    assert _rules(journal(*FLIGHT, (20.0, "LAND")), wire(LANDS, Order(29.0, "autopilot", "DISARM", 0.0))) == []


def test_what_was_in_the_air_is_not_to_be_called_not_flown():
    stood = wire(heights=((9.0, 0.0), (15.0, 0.2)))

    assert _rules(journal((10.0, "TAKEOFF")), stood, "NOT_FLOWN") == []
    assert _rules(journal((10.0, "TAKEOFF")), wire(), "LANDED_EARLY") == []
    assert _rules(journal((10.0, "TAKEOFF")), wire(), "NOT_FLOWN") == ["it was 2.5 m up, and is said to be NOT_FLOWN"]


def test_disarming_in_the_air_is_bad():
    bad = wire(Order(21.0, "planner", "DISARM", 1.3))

    assert _rules(journal(*FLIGHT), bad) == ["planner sent DISARM at 1.3 m"]


def test_flying_on_while_the_engine_lands_is_bad():
    bad = wire(LANDS, Order(21.0, "planner", "AUTO.MISSION", 2.0), Order(21.5, "planner", "AUTO.MISSION", 2.0))

    assert _rules(journal(*FLIGHT, (20.0, "LAND")), bad) == [
        "planner ordered AUTO.MISSION 0.95 s later, while the engine lands (2 such orders)"
    ]


def test_any_order_while_the_pilot_has_control_is_bad_and_his_own_are_not():
    his = Order(22.0, "station", "AUTO.LAND", 2.0)

    assert _rules(journal(*FLIGHT, (20.0, "PILOT")), wire(his)) == []
    assert _rules(journal(*FLIGHT, (20.0, "PILOT")), wire(his, Order(22.5, "autopilot", "AUTO.LAND", 2.0))) == [
        "autopilot ordered AUTO.LAND 2.45 s later, while the pilot has control (1 such orders)"
    ]


def test_an_arming_of_ours_is_taken_back_on_the_ground_before_the_pilot_has_flown_and_not_after():
    rows, disarms = journal(*FLIGHT, (20.0, "PILOT")), Order(20.5, "planner", "DISARM", 0.0)

    assert _rules(rows, wire(disarms, heights=((9.0, 0.0), (30.0, 0.0)))) == []
    assert _rules(rows, wire(disarms)) == [
        "planner ordered DISARM 0.45 s later, while the pilot has control (1 such orders)"
    ]


def test_what_is_ordered_after_the_flight_is_no_matter():
    assert _rules(journal(*FLIGHT, (20.0, "LAND")), wire(Order(31.0, "planner", "AUTO.LOITER", 0.0))) == []


def test_reactions_are_measured_on_the_wire():
    measured = _measured(journal(*FLIGHT, (20.0, "LAND"), code_16_s=20.0, sent=((20.0, "LAND"),)), wire(LANDS))

    assert measured == pytest.approx(
        {
            "code_16_to_order_s": 0.1,
            "code_16_to_mode_s": 0.4,
            "land_to_mode_s": 0.4,
            "flight_s": 20.0,
            "max_height_m": 2.5,
        }
    )


def test_the_pilots_mode_is_measured_to_the_state_pilot():
    taken = [*ARMED[:2], Shown(15.3, True, "POSCTL"), Shown(30.0, False, "POSCTL")]
    by_sticks = wire(Order(15.0, "station", "POSCTL", 2.0), shown=taken)

    assert _measured(journal(*FLIGHT, (15.5, "PILOT")), by_sticks)["pilot_after_mode_s"] == pytest.approx(0.2)


def test_what_the_journal_grows_by_is_that_of_the_mission_alone(tmp_path):
    decision = '{"after":"%s","kind":"decision","t_ns":%d,"commands":[]}\n'
    entered = decision % ("MISSION", 10**9)
    said = "x" * (2000 - len(entered) - 1) + "\n"
    (tmp_path / "journal.jsonl").write_text(
        decision % ("TAKEOFF", 0) + entered + said + decision % ("LAND", 3 * 10**9) + 9 * said
    )
    assert read_journal(tmp_path / "journal.jsonl", 0.0).mb_per_hour == pytest.approx(3.6)
    (tmp_path / "journal.jsonl").write_text(entered + said)
    assert read_journal(tmp_path / "journal.jsonl", 0.0).mb_per_hour is None


EXPECTED = {"result": ["COMPLETE"], "states": [["TAKEOFF", "MISSION"]], "at_most": {"hold_to_mode_s": 0.5}}


@pytest.mark.parametrize(
    "result, states, measured, wrong",
    [
        ("COMPLETE", ("TAKEOFF", "MISSION"), {"hold_to_mode_s": 0.4}, []),
        ("PILOT", ("TAKEOFF", "MISSION"), {"hold_to_mode_s": 0.4}, ["the result is PILOT, not COMPLETE"]),
        ("COMPLETE", ("TAKEOFF",), {"hold_to_mode_s": 0.4}, ["the states are TAKEOFF, not TAKEOFF MISSION"]),
        ("COMPLETE", ("TAKEOFF", "MISSION"), {}, ["hold_to_mode_s was never measured"]),
        (
            "COMPLETE",
            ("TAKEOFF", "MISSION"),
            {"hold_to_mode_s": 0.6},
            ["hold_to_mode_s is 0.600, must be at most 0.5"],
        ),
    ],
)
def test_what_is_not_as_expected_is_said(result, states, measured, wrong):
    assert _expected(EXPECTED, result, states, wire(), measured, journal()) == wrong


def test_a_way_that_goes_on_is_good_where_its_beginning_is_meant():
    way = {"result": [""], "states": [["TAKEOFF"]], "begins": True}

    assert _expected(way, "PILOT", ("TAKEOFF", "MISSION"), wire(), {}, journal()) == []
    assert _expected(way, "PILOT", ("MISSION",), wire(), {}, journal()) == ["the states are MISSION, not TAKEOFF"]


def test_modes_are_those_shown_while_armed():
    expect = {"result": ["COMPLETE"], "states": [[]], "modes": ["AUTO.MISSION"]}

    assert _expected(expect, "COMPLETE", (), wire(), {}, journal()) == [
        "the modes are AUTO.MISSION AUTO.LAND, not AUTO.MISSION"
    ]


@pytest.mark.parametrize(
    "again, wrong",
    [
        ([(0.0, "x", 0.0), (10.05, "False", 0.0), (20.02, "True", 0.0)], []),
        ([(0.0, "x", 0.0), (9.5, "False", 0.0), (20.02, "True", 0.0)], []),
        (
            [(0.0, "x", 0.0), (10.05, "False", 0.0), (20.2, "True", 0.0)],
            ["its telemetry log has armed 0.200 s earlier or later than it was heard"],
        ),
        (
            [(0.0, "x", 0.0), (10.05, "False", 0.0)],
            ["its telemetry log says of armed x False, the flight heard False False True"],
        ),
    ],
)
def test_a_log_that_replays_otherwise_is_bad(again, wrong):
    heard = [(9.0, "False", 0.0), (10.0, "False", 0.45), (20.0, "True", 0.0)]

    assert _compared("armed", heard, again, 0.1) == wrong
