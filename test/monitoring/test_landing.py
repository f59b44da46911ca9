"""Landing detection as flights: what counts as on the ground, airborne, and landed."""

from __future__ import annotations

from math import nan
from typing import Callable, List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from monitoring_feed import S, rounded

from amaze_autonomy.engine.events import Check, Landed, VehicleLanded, Verdict
from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.landing import LandingDetector, LandingVerdict
from amaze_autonomy.monitoring.specs import LandingSpec

Height = Callable[[float], float]
GROUND, AIR, UNKNOWN = Landed.ON_GROUND, Landed.AIRBORNE, Landed.UNKNOWN


class Flight:
    """Flies a profile of heights with a range finder at 50 Hz, 0.1 m above the feet."""

    def __init__(self, *, speed: bool = True) -> None:
        self.detector = LandingDetector()
        self.t_s = 0.0
        self.speed = speed
        self.climb_m_s: Optional[float] = None  # told, instead of what the range finder sees
        self.autopilot: Optional[VehicleLanded] = None
        self.changes: List[Tuple[float, Landed]] = []

    def fly(self, seconds: float, height: Height) -> Flight:
        begin_s = self.t_s
        while self.t_s < begin_s + seconds - 1e-9:
            self.t_s = round(self.t_s + 0.02, 6)
            t_ns, at_s = round(self.t_s * S), self.t_s - begin_s
            if self.climb_m_s is not None:
                self.detector.add_vertical_speed(t_ns, self.climb_m_s)
            elif self.speed:
                self.detector.add_vertical_speed(t_ns, (height(at_s) - height(at_s - 0.02)) / 0.02)
            if self.autopilot is not None:
                self.detector.add_autopilot(t_ns, self.autopilot)
            self.detector.add_range(t_ns, height(at_s) + 0.1)
            self._note(t_ns)
        return self

    def _note(self, t_ns: int) -> None:
        landed = self.detector.evaluate(t_ns).landed
        if not self.changes or self.changes[-1][1] is not landed:
            self.changes.append((self.t_s, landed))

    @property
    def said(self) -> List[Landed]:
        return [landed for _, landed in self.changes]


def level(height_m: float) -> Height:
    return lambda _: height_m


def ramp(begin_m: float, end_m: float, seconds: float) -> Height:
    return lambda t_s: begin_m + (end_m - begin_m) * min(1.0, max(0.0, t_s / seconds))


@pytest.fixture
def hovering() -> Flight:
    """Return a flight that stands at first, climbs, and hovers at 2 m."""
    flight = Flight().fly(2.0, level(0.0)).fly(2.0, ramp(0.0, 2.0, 2.0)).fly(2.0, level(2.0))
    assert flight.said == [UNKNOWN, GROUND, AIR]
    return flight


def test_a_judgement_is_steady_while_distances_agree_with_it():
    flight = Flight()
    assert flight.detector.steady is UNKNOWN
    assert flight.fly(2.0, level(0.0)).detector.steady is GROUND
    assert flight.fly(2.0, ramp(0.0, 2.0, 2.0)).fly(2.0, level(2.0)).detector.steady is AIR
    assert flight.fly(0.5, level(0.0)).detector.steady is UNKNOWN


@pytest.mark.parametrize("count", [1, 4, 50, 203])
def test_readings_that_are_skipped_count_as_if_each_had_been_added(count: int):
    added, skipped = (Flight().fly(2.0, level(0.0)) for _ in range(2))
    times = [round((2.0 + 0.02 * number) * S) for number in range(1, count + 1)]
    ranges = [0.1 + 0.0001 * number for number in range(1, count + 1)]
    for t_ns, range_m in zip(times, ranges):
        added.detector.add_range(t_ns, range_m)
    skipped.detector.skip(times, [each - 0.1 for each in ranges])
    assert skipped.detector.evaluate(times[-1]) == added.detector.evaluate(times[-1])
    assert added.detector.steady is skipped.detector.steady is GROUND
    for each in (added, skipped):  # and what comes next is judged at the same times
        each.t_s = times[-1] / S
        each.fly(3.0, ramp(0.0, 2.0, 2.0))
    assert skipped.changes == added.changes


@pytest.mark.parametrize("t_ns", [0, 1, S])
def test_the_first_reading_is_judged_at_once(t_ns: int):
    detector = LandingDetector(LandingSpec(min_samples=1, mounting_height_m=0.0))
    detector.add_range(t_ns, 1.0)
    assert detector.evaluate(t_ns)[:2] == (UNKNOWN, 1.0)


def test_a_vehicle_that_stands_is_on_the_ground_after_half_a_second():
    flight = Flight().fly(1.0, level(0.0))
    assert flight.said == [UNKNOWN, GROUND]
    assert 0.5 <= flight.changes[1][0] <= 0.65


FLYING = [VehicleLanded.TAKING_OFF, VehicleLanded.IN_AIR, VehicleLanded.LANDING]


@pytest.mark.parametrize("said", [None, VehicleLanded.UNKNOWN, VehicleLanded.ON_GROUND])
def test_a_start_on_the_ground_is_short_as_long_as_the_autopilot_does_not_say_that_it_flies(
    said: Optional[VehicleLanded],
):
    flight = Flight()
    flight.autopilot = said
    flight.fly(1.0, level(0.0))
    assert flight.said == [UNKNOWN, GROUND]
    assert 0.5 <= flight.changes[1][0] <= 0.65


@pytest.mark.parametrize("said", FLYING)
def test_a_start_low_in_the_air_is_not_on_the_ground_while_the_autopilot_says_that_it_flies(said: VehicleLanded):
    flight = Flight()
    flight.autopilot = said
    assert flight.fly(5.0, level(0.05)).said == [UNKNOWN]
    flight.autopilot = VehicleLanded.ON_GROUND
    assert flight.fly(1.9, level(0.0)).said == [UNKNOWN]
    assert flight.fly(0.2, level(0.0)).said == [UNKNOWN, GROUND]


def test_a_single_word_that_it_flies_makes_the_long_dwell_and_stillness_count():
    flight = Flight()
    flight.detector.add_autopilot(0, VehicleLanded.IN_AIR)
    flight.fly(0.5 + 0.02 + 1.9, level(0.0))  # it is silent, and counts for half a second
    assert flight.said == [UNKNOWN]
    assert flight.fly(0.2, level(0.0)).said == [UNKNOWN, GROUND]


@pytest.mark.parametrize("said", FLYING)
@pytest.mark.parametrize("before", [None, VehicleLanded.UNKNOWN])
def test_a_judgement_without_the_autopilot_is_taken_back_when_it_says_that_it_flies(
    before: Optional[VehicleLanded], said: VehicleLanded
):
    flight = Flight()
    flight.autopilot = before
    assert flight.fly(1.0, level(0.05)).said == [UNKNOWN, GROUND]
    flight.autopilot = said
    assert flight.fly(0.1, level(0.05)).said == [UNKNOWN, GROUND, UNKNOWN]
    verdict = flight.detector.evaluate(round(flight.t_s * S))
    reason = "near the ground, but it moves or the autopilot says that it flies"
    assert (verdict.distance_m, verdict.reason) == (pytest.approx(0.05), reason)
    assert flight.fly(5.0, level(0.05)).said == [UNKNOWN, GROUND, UNKNOWN]
    flight.autopilot = VehicleLanded.ON_GROUND
    assert flight.fly(1.9, level(0.0)).said == [UNKNOWN, GROUND, UNKNOWN]
    assert flight.fly(0.2, level(0.0)).said == [UNKNOWN, GROUND, UNKNOWN, GROUND]


@pytest.mark.parametrize("distance_m, near", [(0.15, True), (0.1501, False)])
def test_the_ground_distance_itself_is_near_the_ground_in_words_too(distance_m: float, *, near: bool):
    detector = LandingDetector(LandingSpec(min_samples=1, mounting_height_m=0.0, ground_distance_m=0.15))
    detector.add_autopilot(0, VehicleLanded.IN_AIR)
    detector.add_range(1, distance_m)
    assert ("it moves or the autopilot says" in detector.evaluate(1).reason) is near


@pytest.mark.parametrize("said", FLYING)
def test_a_judgement_that_the_autopilot_agreed_to_stands_until_it_is_far_from_the_ground(said: VehicleLanded):
    flight = Flight().fly(1.0, level(0.0))
    for flight.autopilot in (VehicleLanded.ON_GROUND, said):
        flight.fly(1.0, level(0.0))
    assert flight.said == [UNKNOWN, GROUND]
    assert flight.fly(2.0, level(2.0)).said == [UNKNOWN, GROUND, AIR]


@pytest.fixture
def standing() -> Flight:
    """Return a flight that stands on the pad, as range finder and autopilot say."""
    flight = Flight()
    flight.autopilot = VehicleLanded.ON_GROUND
    flight.fly(2.0, level(0.0))
    assert flight.said == [UNKNOWN, GROUND]
    return flight


def say(flight: Flight, seconds: float, said: Optional[VehicleLanded], climb_m_s: float = 0.0) -> Flight:
    """Let the autopilot say something while the range finder sees the ground."""
    flight.autopilot, flight.climb_m_s = said, climb_m_s
    return flight.fly(seconds, level(0.0))


@pytest.mark.parametrize(
    "said, climb_m_s",
    [
        (VehicleLanded.IN_AIR, 0.0),
        (VehicleLanded.LANDING, 0.0),
        (VehicleLanded.TAKING_OFF, 3.0),
        (VehicleLanded.UNKNOWN, -0.21),
        (VehicleLanded.UNKNOWN, 3.0),
    ],
)
def test_a_range_finder_that_sees_the_ground_all_through_a_flight_is_not_believed(
    standing: Flight, said: VehicleLanded, climb_m_s: float
):
    assert say(standing, 2.0, said, climb_m_s).said == [UNKNOWN, GROUND]
    say(standing, 60.0, said, climb_m_s)
    assert standing.said == [UNKNOWN, GROUND, UNKNOWN]
    assert 4.0 <= standing.changes[-1][0] <= 4.1
    assert say(standing, 60.0, VehicleLanded.ON_GROUND).said == [UNKNOWN, GROUND, UNKNOWN]


def test_a_range_finder_that_is_not_believed_is_named_in_the_check(standing: Flight):
    say(standing, 3.0, VehicleLanded.IN_AIR)
    say(standing, 3.0, VehicleLanded.ON_GROUND)
    reason = "the range finder saw the ground while the vehicle flew"
    advice = f"{reason}: check it, then lift the vehicle until it sees more than 0.10 m"
    assert standing.detector.evaluate(8 * S).reason == reason
    assert standing.detector.checks(8 * S) == (
        Check("range age", Verdict.PASS, 0.0, 0.5, "s", 0.0),
        Check("distance to ground", Verdict.UNKNOWN, 0.0, 0.1, "m", 0.0, advice),
    )


def test_a_range_finder_is_believed_again_once_it_has_seen_that_the_ground_is_farther_away(standing: Flight):
    say(standing, 3.0, VehicleLanded.IN_AIR)
    standing.fly(0.5, level(0.15))
    say(standing, 1.9, VehicleLanded.ON_GROUND)
    assert standing.said == [UNKNOWN, GROUND, UNKNOWN]
    assert say(standing, 0.4, VehicleLanded.ON_GROUND).said == [UNKNOWN, GROUND, UNKNOWN, GROUND]


def test_a_low_hover_that_the_range_finder_sees_is_no_doubt(standing: Flight):
    standing.autopilot = VehicleLanded.IN_AIR
    assert standing.fly(3.0, level(0.2)).said == [UNKNOWN, GROUND, UNKNOWN]
    assert say(standing, 2.5, VehicleLanded.ON_GROUND).said == [UNKNOWN, GROUND, UNKNOWN, GROUND]


@pytest.mark.parametrize(
    "words",
    [
        [(2.0, VehicleLanded.IN_AIR, 0.0)],
        [(1.9, VehicleLanded.IN_AIR, 0.0), (0.1, VehicleLanded.ON_GROUND, 0.0), (1.9, VehicleLanded.IN_AIR, 0.0)],
        [(60.0, VehicleLanded.TAKING_OFF, 0.2)],
        [(1.9, VehicleLanded.TAKING_OFF, 0.5), (0.1, VehicleLanded.TAKING_OFF, 0.0), (1.9, VehicleLanded.IN_AIR, 0.0)],
        [(60.0, VehicleLanded.ON_GROUND, 2.0), (60.0, VehicleLanded.ON_GROUND, -2.0)],
        [(60.0, None, 0.0)],
    ],
    ids=["spool-up", "flapping", "long spool-up", "shaken at spool-up", "on a lift or a ship", "autopilot silent"],
)
def test_a_vehicle_that_stands_is_on_the_ground_whatever_is_said_for_a_moment(
    standing: Flight, words: List[Tuple[float, Optional[VehicleLanded], float]]
):
    for seconds, said, climb_m_s in words:
        say(standing, seconds, said, climb_m_s)
    assert standing.said == [UNKNOWN, GROUND]


@pytest.mark.parametrize("late", [VehicleLanded.IN_AIR, VehicleLanded.LANDING])
def test_it_has_landed_however_late_the_autopilot_says_so(hovering: Flight, late: VehicleLanded):
    hovering.autopilot = late
    hovering.fly(2.0, ramp(2.0, 0.0, 2.0)).fly(60.0, level(0.0))
    assert hovering.said == [UNKNOWN, GROUND, AIR]
    hovering.autopilot = VehicleLanded.ON_GROUND
    assert hovering.fly(2.2, level(0.0)).said == [UNKNOWN, GROUND, AIR, GROUND]


def test_a_vehicle_that_is_lost_from_sight_while_it_takes_off_needs_the_long_dwell():
    flight = Flight()
    flight.autopilot = VehicleLanded.ON_GROUND
    flight.fly(1.0, level(0.0))
    flight.autopilot = VehicleLanded.TAKING_OFF
    assert flight.fly(1.0, level(nan)).fly(3.0, level(0.05)).said == [UNKNOWN, GROUND, UNKNOWN]
    flight.autopilot = VehicleLanded.ON_GROUND
    assert flight.fly(1.9, level(0.0)).said == [UNKNOWN, GROUND, UNKNOWN]
    assert flight.fly(0.2, level(0.0)).said == [UNKNOWN, GROUND, UNKNOWN, GROUND]


def test_it_is_airborne_soon_after_lift_off(hovering: Flight):
    crossing_s = 2.0 + 0.3  # 1 m/s
    assert crossing_s + 0.5 <= hovering.changes[2][0] <= crossing_s + 0.8


def test_it_has_landed_two_seconds_after_touchdown(hovering: Flight):
    hovering.fly(2.0, ramp(2.0, 0.0, 2.0)).fly(4.0, level(0.0))
    assert hovering.said == [UNKNOWN, GROUND, AIR, GROUND]
    assert 8.0 + 1.9 <= hovering.changes[3][0] <= 8.0 + 2.3


def test_a_bounce_begins_the_dwell_anew(hovering: Flight):
    hovering.fly(2.0, ramp(2.0, 0.0, 2.0)).fly(1.5, level(0.0)).fly(0.4, level(0.25)).fly(1.9, level(0.0))
    assert hovering.said[-1] is AIR
    hovering.fly(1.0, level(0.0))
    assert hovering.said[-1] is GROUND


def test_a_low_pass_over_the_pad_is_no_landing(hovering: Flight):
    hovering.fly(1.0, ramp(2.0, 0.08, 1.0)).fly(1.5, level(0.08)).fly(1.0, ramp(0.08, 2.0, 1.0)).fly(2.0, level(2.0))
    assert hovering.said == [UNKNOWN, GROUND, AIR]


def test_a_hand_under_the_sensor_on_the_way_down_is_no_landing(hovering: Flight):
    hovering.autopilot = VehicleLanded.LANDING
    hovering.fly(5.0, level(-0.05))
    assert hovering.said[-1] is AIR
    hovering.autopilot = VehicleLanded.ON_GROUND
    hovering.fly(2.5, level(0.0))
    assert hovering.said[-1] is GROUND


def test_a_descent_that_the_sensor_does_not_see_is_no_landing(hovering: Flight):
    for index in range(200):
        t_ns = round((hovering.t_s + 0.02 * (index + 1)) * S)
        hovering.detector.add_vertical_speed(t_ns, -0.5)
        hovering.detector.add_range(t_ns, 0.1)
        assert hovering.detector.evaluate(t_ns).landed is AIR


def test_something_nearer_than_the_ground_can_be_is_unknown():
    detector = LandingDetector(LandingSpec(mounting_height_m=0.4))
    for index in range(50):
        detector.add_range(index * S // 50, 0.05)
    reason = "something is nearer to the range finder than the ground can be"
    assert detector.evaluate(S)[:3] == (UNKNOWN, None, reason)


@pytest.mark.parametrize("nothing", [nan, float("inf"), -1.0, 8191.0, 40.0, -0.1])
def test_nothing_seen_is_unknown_and_never_on_the_ground(hovering: Flight, nothing: float):
    begin_s = hovering.t_s
    hovering.fly(2.0, level(nothing))
    assert hovering.said[-1] is UNKNOWN
    assert hovering.changes[-1][0] - begin_s <= 0.55


def test_a_vehicle_that_was_airborne_needs_the_long_dwell_also_after_unknown(hovering: Flight):
    hovering.fly(2.0, level(nan)).fly(1.9, level(0.0))
    assert hovering.said[-1] is UNKNOWN
    hovering.fly(0.5, level(0.0))
    assert hovering.said[-1] is GROUND


def test_a_range_that_stops_is_unknown_at_its_age_limit(hovering: Flight):
    now = round(hovering.t_s * S)
    verdict = hovering.detector.evaluate(now)
    assert verdict == LandingVerdict(AIR, pytest.approx(2.0), "in the air", 0, now + S // 2 + 1)
    assert hovering.detector.evaluate(now + S // 2).landed is AIR
    lost = hovering.detector.evaluate(now + S // 2 + 1)
    assert lost == LandingVerdict(UNKNOWN, None, "nothing seen for longer than 0.5 s", S // 2 + 1, FOREVER_NS)


@pytest.mark.parametrize("gap_s", [0.6, 0.7, 10.0])
def test_a_gap_that_nobody_asked_about_begins_the_dwell_anew(gap_s: float):
    flight = Flight().fly(0.4, level(0.0))
    flight.t_s += gap_s
    flight.fly(0.3, level(0.0))
    assert flight.said == [UNKNOWN]


def test_between_ground_and_air_the_last_judgement_stands():
    flight = Flight().fly(1.0, level(0.0)).fly(5.0, level(0.2))
    assert flight.said == [UNKNOWN, GROUND]
    started_between = Flight().fly(5.0, level(0.2))
    assert started_between.said == [UNKNOWN]
    assert started_between.detector.evaluate(5 * S).reason == "neither near the ground nor clear of it"


def test_time_that_jumps_backwards_begins_anew_and_remembers_the_flight(hovering: Flight):
    hovering.t_s = 1.0
    hovering.fly(1.9, level(0.0))
    assert hovering.said[-1] is UNKNOWN
    hovering.fly(0.5, level(0.0))
    assert hovering.said[-1] is GROUND


def test_readings_of_one_time_all_count():
    detector = LandingDetector()
    for index in range(102):
        detector.add_range(index // 2 * S // 50, 0.1)
    assert detector.evaluate(S).landed is GROUND


def test_the_check_says_how_old_the_range_is():
    flight = Flight().fly(1.0, level(0.0))
    assert [row.age_s for row in flight.detector.checks(S + 3 * S // 10)] == [0.3, 0.3]


def test_the_check_passes_on_the_ground():
    flight = Flight().fly(1.0, level(0.0))
    assert flight.detector.checks(S) == (
        Check("range age", Verdict.PASS, 0.0, 0.5, "s", 0.0),
        Check("distance to ground", Verdict.PASS, 0.0, 0.1, "m", 0.0),
    )


def test_the_check_fails_in_the_air_and_says_what_to_do():
    flight = Flight().fly(1.0, level(0.5))
    advice = "the feet are 0.50 m above the ground, limit 0.10 m: place the vehicle on the ground"
    assert rounded(flight.detector.checks(S)[1]) == Check(
        "distance to ground", Verdict.FAIL, 0.5, 0.1, "m", 0.0, advice
    )


def test_the_check_is_unknown_without_a_range():
    advice = "no range yet: check the range finder, its lens and its topic /lrf/range"
    assert LandingDetector().checks(S) == (
        Check("range age", Verdict.UNKNOWN, None, 0.5, "s", None, advice),
        Check("distance to ground", Verdict.UNKNOWN, None, 0.1, "m", None, "the distance to the ground is unknown"),
    )


LENS = "check the range finder, its lens and its topic /lrf/range"


def blind(reading: float, least: float, most: float, *, before: Optional[float] = None) -> LandingDetector:
    """Return a detector that was told a reading for 2 s; before that another one."""
    detector = LandingDetector()
    for index in range(150):
        told = before if before is not None and index < 50 else reading
        detector.add_range(index * S // 50, told, least, most)
    return detector


@pytest.mark.parametrize(
    "reading, least, most, advice",
    [
        (0.1, 0.2, 40.0, "0.1 m is below the sensor's least range of 0.2 m: mount it higher"),
        (0.019, nan, nan, "0.019 m is below min_range_m of 0.02 m: mount it higher"),
        (12.0, 0.02, 12.0, f"12 m is not below the sensor's largest range of 12 m: {LENS}"),
        (40.0, nan, nan, f"40 m is not below max_range_m of 40 m: {LENS}"),
        (nan, 0.2, 40.0, f"0 good ranges, 3 are needed: {LENS}"),
        (0.0, 0.2, 40.0, f"0 good ranges, 3 are needed: {LENS}"),
        (8191.0, 0.2, 40.0, f"0 good ranges, 3 are needed: {LENS}"),
        (float("inf"), 0.2, 40.0, f"0 good ranges, 3 are needed: {LENS}"),
    ],
)
def test_the_check_says_at_which_limit_a_range_is_nothing_seen(reading: float, least: float, most: float, advice: str):
    assert blind(reading, least, most).checks(3 * S) == (
        Check("range age", Verdict.UNKNOWN, None, 0.5, "s", None, advice),
        Check("distance to ground", Verdict.UNKNOWN, None, 0.1, "m", None, "the distance to the ground is unknown"),
    )


def test_a_vehicle_that_is_put_down_where_its_range_finder_is_blind_is_told_so_and_not_that_it_is_silent():
    row = blind(0.1, 0.2, 40.0, before=0.5).checks(3 * S)[0]
    assert row.advice == "0.1 m is below the sensor's least range of 0.2 m: mount it higher"
    silent = blind(0.1, 0.2, 40.0, before=0.5).checks(4 * S)[0]
    assert silent.advice == f"nothing seen for longer than 0.5 s: {LENS}"


def test_a_range_finder_that_sees_again_is_not_called_blind():
    detector = blind(0.5, 0.2, 40.0, before=0.1)
    assert detector.evaluate(3 * S).reason == "in the air"
    assert detector.evaluate(4 * S).reason == "nothing seen for longer than 0.5 s"


def test_the_check_waits_until_the_judgement_has_settled():
    flight = Flight().fly(0.3, level(0.0))
    row = flight.detector.checks(round(0.3 * S))[1]
    assert (row.verdict, row.advice) == (Verdict.UNKNOWN, "near the ground, not yet for 0.5 s, wait")


readings = st.one_of(st.floats(), st.sampled_from([0.1, 0.1, 0.15, 0.5, 2.0, 8191.0]))


@given(st.lists(st.tuples(st.integers(0, S), readings), max_size=150), st.randoms())
def test_the_judgement_does_not_depend_on_how_often_one_asks(steps: List[Tuple[int, float]], random):
    asked, quiet, now = LandingDetector(), LandingDetector(), 0
    for step_ns, reading in steps:
        asked.evaluate(now + random.randrange(step_ns + 1))
        now += step_ns
        asked.add_range(now, reading)
        quiet.add_range(now, reading)
        assert asked.evaluate(now)[:2] == quiet.evaluate(now)[:2]


@given(st.lists(st.tuples(st.integers(0, 2**62), st.floats(), st.floats(), st.sampled_from(list(VehicleLanded)))))
def test_no_number_breaks_it(calls: List[tuple]):
    detector = LandingDetector()
    for t_ns, reading, speed, landed in calls:
        detector.add_vertical_speed(t_ns, speed)
        detector.add_autopilot(t_ns, landed)
        detector.add_tilt(t_ns, speed)
        detector.add_range(t_ns, reading, speed, reading)
        verdict = detector.evaluate(t_ns)
        assert verdict.landed is UNKNOWN or verdict.distance_m is not None
        detector.checks(t_ns)
