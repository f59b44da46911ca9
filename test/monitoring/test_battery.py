"""Is the battery enough for the next mission; what it does not know stays unknown."""

from __future__ import annotations

from math import inf, nan
from typing import Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from monitoring_feed import S, rounded

from amaze_autonomy.engine.events import Check, Verdict
from amaze_autonomy.monitoring.battery import BatteryMonitor, BatteryVerdict, PackVolts
from amaze_autonomy.monitoring.specs import BatterySpec


def battery(fraction: Optional[float], voltage_v: Optional[float] = 23.4) -> BatteryMonitor:
    monitor = BatteryMonitor()
    monitor.add(10 * S, fraction, voltage_v)
    return monitor


def test_enough_for_the_mission_is_ok():
    verdict = battery(0.8).check(11 * S, 0.5)
    assert verdict._replace(checks=tuple(rounded(row) for row in verdict.checks)) == BatteryVerdict(
        True,
        0.8,
        23.4,
        (
            Check("battery age", Verdict.PASS, 1.0, 5.0, "s", 1.0),
            Check("battery fraction", Verdict.PASS, 0.8, 0.5, "fraction", 1.0),
            Check("battery cell voltage", Verdict.PASS, 3.9, 3.5, "V", 1.0, other_limit=4.35),
        ),
    )


@pytest.mark.parametrize(
    "fraction,required,ok",
    [(0.5, 0.5, True), (0.499, 0.5, False), (0.3, 0.1, True), (0.29, 0.1, False), (1.0, 1.0, True)],
)
def test_the_limit_is_what_the_mission_needs_and_never_below_the_minimum(fraction: float, required: float, ok: bool):  # noqa: FBT001
    assert battery(fraction).check(11 * S, required).ok is ok


@pytest.mark.parametrize(
    "required,advice",
    [
        (0.9, "80% is left, the mission needs 90%: change or charge the battery"),
        (0.85, "80% is left, the mission needs 85%: change or charge the battery"),
    ],
)
def test_not_enough_says_how_much_is_needed(required: float, advice: str):
    verdict = battery(0.8).check(11 * S, required)
    assert verdict.checks[1] == Check("battery fraction", Verdict.FAIL, 0.8, required, "fraction", 1.0, advice)


def test_below_the_minimum_says_so():
    row = battery(0.2).check(11 * S, 0.1).checks[1]
    assert row.advice == "20% is left, no mission starts below 30%: change or charge the battery"


@pytest.mark.parametrize("fraction", [None, -1.0, -0.53, nan, inf, 1.01, 99.0])
def test_a_level_that_it_does_not_know_stays_unknown(fraction: Optional[float]):
    verdict = battery(fraction).check(11 * S, 0.0)
    assert (verdict.ok, verdict.fraction, verdict.checks[1].verdict) == (False, None, Verdict.UNKNOWN)


def test_an_empty_battery_is_known_to_be_empty():
    row = battery(0.0).check(11 * S, 0.5).checks[1]
    assert (row.verdict, row.value) == (Verdict.FAIL, 0.0)


def test_unknown_after_known_is_unknown():
    monitor = battery(0.8)
    monitor.add(11 * S, -1.0, 23.4)
    assert monitor.check(11 * S, 0.1).ok is False


@pytest.mark.parametrize("required", [None, nan, -0.1, 1.2])
def test_a_mission_that_does_not_say_what_it_needs_is_unknown(required: Optional[float]):
    row = battery(0.8).check(11 * S, required).checks[1]
    assert (row.verdict, row.limit) == (Verdict.UNKNOWN, None)


@pytest.mark.parametrize(
    "voltage_v,verdict",
    [
        (None, Verdict.UNKNOWN),
        (0.0, Verdict.UNKNOWN),
        (-1.0, Verdict.UNKNOWN),
        (nan, Verdict.UNKNOWN),
        (12.6, Verdict.FAIL),
        (20.9, Verdict.FAIL),
        (21.1, Verdict.PASS),
        (26.0, Verdict.PASS),
        (30.0, Verdict.FAIL),
    ],
)
def test_the_voltage_of_a_cell_must_be_one_that_it_can_fly_with(voltage_v: Optional[float], verdict: Verdict):
    answer = battery(0.8, voltage_v).check(11 * S, 0.5)
    assert answer.checks[2].verdict is verdict
    assert answer.ok is (verdict is Verdict.PASS)


FLAT, SIX_CELLS = "3.00 V per cell of 4, limit 3.50 V: change or charge the battery", "6.25 V per cell cannot be"
ONE, OTHER = PackVolts(16.6, name="battery 0"), PackVolts(16.4, name="battery 1")


@pytest.mark.parametrize(
    "packs,verdict,value,words",
    [
        ((ONE, OTHER), Verdict.PASS, 4.1, ""),
        ((PackVolts(12.0),), Verdict.FAIL, 3.0, FLAT),
        ((ONE, OTHER._replace(voltage_v=12.0)), Verdict.FAIL, 3.0, f"battery 1: {FLAT}"),
        ((ONE._replace(voltage_v=12.0), OTHER), Verdict.FAIL, 3.0, f"battery 0: {FLAT}"),
        ((ONE, OTHER._replace(voltage_v=25.0)), Verdict.FAIL, 6.25, f"battery 1: {SIX_CELLS}"),
        ((ONE, OTHER._replace(voltage_v=None)), Verdict.UNKNOWN, None, "battery 1: the voltage is unknown"),
        ((ONE._replace(voltage_v=12.0), OTHER._replace(voltage_v=nan)), Verdict.FAIL, 3.0, f"battery 0: {FLAT}"),
        ((PackVolts(16.6, (4.15,) * 4),), Verdict.PASS, 4.15, ""),
        ((PackVolts(14.85, (4.15, 4.15, 4.15, 2.4)),), Verdict.FAIL, 2.4, "2.40 V in one cell of 4, limit 3.50 V"),
        ((PackVolts(12.45, (4.15, 4.15, 4.15, 0.0)),), Verdict.FAIL, 0.0, "0.00 V in one cell of 4"),
        ((PackVolts(16.0, (3.8, 3.8, 3.8, 4.6)),), Verdict.FAIL, 4.6, "4.60 V in one cell cannot be"),
        ((PackVolts(24.6, (4.1,) * 6),), Verdict.FAIL, 6.15, "6.15 V per cell cannot be: is it 4 cells"),
    ],
)
def test_the_lowest_and_the_highest_cell_of_each_pack_must_be_ones_that_it_can_fly_with(
    packs: Tuple[PackVolts, ...], verdict: Verdict, value: Optional[float], words: str
):
    monitor = BatteryMonitor(BatterySpec(cells=4))
    monitor.add(10 * S, 1.0, 16.6, packs)
    answer = monitor.check(11 * S, 0.5)
    row = answer.checks[2]
    assert (row.verdict, row.value) == (verdict, None if value is None else pytest.approx(value))
    assert row.advice.startswith(words)
    assert (answer.ok, answer.voltage_v) == (verdict is Verdict.PASS, 16.6)


def test_without_a_number_of_cells_nobody_looks_at_the_voltage():
    monitor = BatteryMonitor(BatterySpec(cells=0))
    monitor.add(0, 0.8, None)
    assert monitor.check(0, 0.5).ok


@pytest.mark.parametrize(
    "t_ns,advice",
    [
        (15 * S + 1, "the battery's last message is 5 s old: check the link to the autopilot"),
        (4 * S, "the battery's last message is 6 s in the future, clocks differ: check the link to the autopilot"),
    ],
)
def test_an_old_word_and_one_from_the_future_do_not_count(t_ns: int, advice: str):
    verdict = battery(0.8).check(t_ns, 0.5)
    assert (verdict.ok, verdict.checks[0].advice) == (False, advice)


def test_a_battery_that_never_said_anything_is_unknown():
    verdict = BatteryMonitor().check(S, 0.5)
    assert [row.verdict for row in verdict.checks] == [Verdict.UNKNOWN] * 3
    assert verdict[:3] == (False, None, None)


@given(st.none() | st.floats(), st.none() | st.floats(), st.none() | st.floats(), st.integers(0, 2**62))
def test_no_number_breaks_it_and_ok_means_enough(
    fraction: Optional[float], voltage_v: Optional[float], required: Optional[float], t_ns: int
):
    monitor = BatteryMonitor()
    monitor.add(t_ns, fraction, voltage_v)
    verdict = monitor.check(t_ns, required)
    if verdict.ok:
        assert fraction is not None
        assert required is not None
        assert required <= fraction <= 1.0


def test_a_battery_that_was_never_heard_is_waited_for_and_one_that_does_not_know_its_level_is_not():
    """Asked in the second after a start, it has not had the time to say anything: that comes by itself."""
    monitor = BatteryMonitor(BatterySpec(cells=4))
    assert [row.heals for row in monitor.check(0, 0.5).checks] == [True] * 3
    monitor.add(0, None)
    assert not any(row.heals for row in monitor.check(0, 0.5).checks)
