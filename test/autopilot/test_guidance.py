"""Set-points: where the point that runs ahead is, what is sent without a pose, and when a waypoint is reached."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from amaze_autonomy.autopilot.planner.guidance import Climb, Guidance
from amaze_autonomy.autopilot.planner.mission_vehicle import Pose
from amaze_autonomy.missions import FlightModel, PlannerSpec, Waypoint

S, STEP_NS = 1_000_000_000, 50_000_000
MODEL = FlightModel(cruise_speed_m_s=2.0, climb_speed_m_s=1.0, descent_speed_m_s=0.5, acceleration_m_s2=1.0)
SPEC = PlannerSpec()
ORIGIN = (10.0, -5.0, 0.5)
TARGET = (1, 1)
CLIMB = Climb(1.0, 1.0)
BY_POSITION, BY_VELOCITY = 0x9F8, 0xDC7  # what is ignored


def pose(x, y, z, speed=0.0, t_ns=0):
    return Pose(t_ns, (x, y, z), (speed, 0.0, 0.0))


def guidance(*waypoints, start=ORIGIN):
    made = Guidance(waypoints, ORIGIN, CLIMB, MODEL, SPEC, pose(*start), 0.0, TARGET)
    made.flying = True
    return made


def place(message):
    """Return where a set-point is, east, north, up."""
    assert message.type_mask == BY_POSITION
    return message.y, message.x, -message.z


class Follower:
    """A vehicle that is where the last set-point was."""

    def __init__(self, guided) -> None:
        self.guided, self.t_ns, self.at = guided, 0, ORIGIN

    def step(self):
        self.t_ns += STEP_NS
        message = self.guided.step(self.t_ns, pose(*self.at, t_ns=self.t_ns), None)
        self.at = place(message)
        return message

    def until(self, condition, limit=4000):
        for _ in range(limit):
            if condition():
                return
            self.step()
        raise AssertionError(f"not within {limit} steps: {self.at}")


@pytest.mark.parametrize("steps_ms", [(50,), (100,), (100, 150), (92, 108)])
def test_its_speed_is_the_model_s_at_each_rate_of_set_points(steps_ms):
    guided, t_ns, at = guidance(Waypoint(0.0, 100.0, 1.0, 0.0, 0.0)), 0, ORIGIN
    places = {}
    for tick in range(400):
        t_ns += steps_ms[tick % len(steps_ms)] * 1_000_000
        at = places[t_ns] = place(guided.step(t_ns, pose(*at), None))
    begin_ns, end_ns = (min(places, key=lambda each: abs(each - t_s * S)) for t_s in (8, 18))
    flown_m = math.dist(places[begin_ns], places[end_ns])
    assert flown_m / ((end_ns - begin_ns) / S) == pytest.approx(MODEL.cruise_speed_m_s, rel=0.01)


def test_it_climbs_straight_up_then_flies_each_leg_then_is_finished():
    guided = guidance(Waypoint(0.0, 4.0, 2.0, 0.0, 1.0), Waypoint(3.0, 4.0, 2.0, math.pi / 2, 0.0))
    follower = Follower(guided)
    while guided.climbing:
        follower.step()
        assert follower.at[:2] == ORIGIN[:2]
    assert follower.at == pytest.approx((10.0, -5.0, 1.5))
    follower.until(lambda: guided.reached == 1)
    assert follower.at == pytest.approx((10.0, -1.0, 2.5))
    follower.until(lambda: guided.finished)
    assert follower.at == pytest.approx((13.0, -1.0, 2.5))
    assert guided.reached == 2


def test_the_climb_is_over_at_its_height_and_not_a_radius_below():
    low = Waypoint(3.0, 0.0, 0.6, 0.0, 0.0)
    guided = Guidance((low,), ORIGIN, Climb(goal_m=1.2, over_m=1.1), MODEL, SPEC, pose(*ORIGIN), 0.0, TARGET)
    guided.flying = True
    x, y, z = ORIGIN
    points = [place(guided.step(number * STEP_NS, pose(x, y, z + 1.05), None)) for number in range(1, 200)]
    assert (guided.climbing, points[-1]) == (True, pytest.approx((x, y, z + 1.2)))
    guided.step(200 * STEP_NS, pose(x, y, z + 1.12), None)
    assert not guided.climbing


@pytest.mark.parametrize("up_m", [1.7, -0.7])
def test_heights_are_above_where_this_file_takes_off_not_where_the_first_did(up_m):
    follower = Follower(guidance(Waypoint(0.0, 4.0, 2.0, 0.0, 0.0), start=(14.0, -5.0, up_m)))
    follower.at = (14.0, -5.0, up_m)
    while follower.guided.climbing:
        follower.step()
        assert follower.at[:2] == (14.0, -5.0)
    assert follower.at[2] >= up_m + 1.0
    follower.until(lambda: follower.guided.finished)
    assert follower.at == pytest.approx((10.0, -1.0, up_m + 2.0))


def test_yaw_is_sent_clockwise_from_north_and_turns_as_fast_as_the_model():
    guided = guidance(Waypoint(0.0, 0.0, 1.0, math.pi / 2, 0.0), Waypoint(9.0, 0.0, 1.0, math.pi / 2, 0.0))
    follower = Follower(guided)
    first = follower.step().yaw
    assert first == pytest.approx(math.pi / 2)  # looks east
    follower.until(lambda: guided.reached == 1)
    yaws = [follower.step().yaw for _ in range(80)]
    turns = [abs(later - earlier) for earlier, later in zip(yaws, yaws[1:])]
    assert yaws[-1] == pytest.approx(0.0, abs=1e-6)  # looks north
    assert max(turns) <= MODEL.turn_rate_rad_s * 0.05 + 1e-6


WAYPOINTS = st.builds(
    Waypoint, st.floats(-20, 20), st.floats(-20, 20), st.floats(0.5, 10), st.floats(-3, 3), st.floats(0, 2)
)


@settings(max_examples=40, deadline=None)
@given(st.lists(WAYPOINTS, min_size=1, max_size=4))
def test_the_point_is_never_faster_than_the_model_and_always_arrives(waypoints):
    guided = guidance(*waypoints)
    follower = Follower(guided)
    steps = 0
    while not guided.finished:
        before = follower.at
        follower.step()
        across = math.dist(before[:2], follower.at[:2]) / 0.05
        up = (follower.at[2] - before[2]) / 0.05
        assert across <= 2.0 + 0.21  # the last centimetre is one step
        assert -0.5 - 0.21 <= up <= 1.0 + 0.21
        steps += 1
        assert steps < 6000
    last = waypoints[-1]
    assert follower.at == pytest.approx((10.0 + last.x_m, -5.0 + last.y_m, 0.5 + last.z_m), abs=1e-6)


def test_a_hold_lasts_as_long_as_it_should():
    guided = guidance(Waypoint(0.0, 0.0, 1.0, 0.0, 2.0))
    follower = Follower(guided)
    follower.until(lambda: guided.reached == 0 and not guided.climbing)
    begin_ns = follower.t_ns
    follower.until(lambda: guided.finished)
    assert follower.t_ns - begin_ns == pytest.approx(2 * S, abs=2 * STEP_NS)


def test_the_point_waits_for_a_vehicle_that_does_not_follow():
    guided = guidance(Waypoint(0.0, 15.0, 1.0, 0.0, 0.0))
    stuck = pose(*ORIGIN)
    ahead = [math.dist(place(guided.step(number * STEP_NS, stuck, None)), ORIGIN) for number in range(1, 400)]
    assert max(ahead) <= 3.0 + 0.2
    assert guided.climbing


def test_a_waypoint_is_not_reached_while_the_vehicle_looks_elsewhere():
    guided = guidance(Waypoint(0.0, 0.0, 1.0, 0.0, 0.0))
    goal = (10.0, -5.0, 1.5)
    for number in range(1, 100):
        guided.step(number * STEP_NS, pose(*goal), 1.0)
    assert guided.climbing
    guided.step(5 * S + STEP_NS, pose(*goal), 0.1)
    assert not guided.climbing


def test_on_the_ground_the_point_stays_where_the_vehicle_is():
    guided = guidance(Waypoint(0.0, 0.0, 1.0, 0.0, 0.0))
    guided.flying = False
    points = {place(guided.step(number * STEP_NS, pose(*ORIGIN), 0.0)) for number in range(1, 50)}
    assert points == {ORIGIN}


def test_without_a_pose_the_set_point_is_to_stand_still_and_the_time_is_counted():
    guided = guidance(Waypoint(0.0, 4.0, 1.0, 0.0, 0.0))
    follower = Follower(guided)
    follower.until(lambda: not guided.climbing)
    begin_ns = follower.t_ns
    message = guided.step(begin_ns + S, None, None)
    assert (message.type_mask, message.vx, message.vy, message.vz) == (BY_VELOCITY, 0.0, 0.0, 0.0)
    assert guided.blind_ns(begin_ns + S) == S
    guided.step(begin_ns + S + STEP_NS, pose(*follower.at), None)
    assert guided.blind_ns(begin_ns + S + STEP_NS) == 0


def test_a_pose_that_jumps_is_not_followed():
    guided = guidance(Waypoint(0.0, 9.0, 1.0, 0.0, 0.0))
    follower = Follower(guided)
    follower.until(lambda: follower.at[1] > -2.0)
    x, y, z = follower.at
    jumped = guided.step(follower.t_ns + S, pose(x + 7.0, y, z), None)
    assert (jumped.type_mask, guided.blind_ns(follower.t_ns + S)) == (BY_VELOCITY, S)
    back = guided.step(follower.t_ns + S + STEP_NS, pose(x, y, z), None)
    assert math.dist(place(back), follower.at) < 0.1
    assert guided.blind_ns(follower.t_ns + S + STEP_NS) == 0


@pytest.mark.parametrize("climb_m_s, descent_m_s", [(3.0, 0.5), (0.5, 3.0)])
def test_a_vehicle_that_lags_on_a_leg_faster_than_its_cruise_has_not_jumped(climb_m_s, descent_m_s):
    model = FlightModel(0.5, climb_speed_m_s=climb_m_s, descent_speed_m_s=descent_m_s, acceleration_m_s2=9.0)
    waypoints = (Waypoint(0.0, 0.0, 13.0, 0.0, 0.0), Waypoint(0.0, 0.0, 1.0, 0.0, 0.0))
    guided = Guidance(waypoints, ORIGIN, CLIMB, model, SPEC, pose(*ORIGIN), 0.0, TARGET)
    guided.flying = True
    follower = Follower(guided)
    follower.until(lambda: guided.reached == (1 if descent_m_s > climb_m_s else 0) and not guided.climbing)
    stuck, begun_ns = follower.at, follower.t_ns
    points = [place(guided.step(begun_ns + number * STEP_NS, pose(*stuck), None)) for number in range(1, 200)]
    assert max(math.dist(point, stuck) for point in points) == pytest.approx(4.5, abs=0.2)


def test_it_begins_where_the_vehicle_is_on_a_climb_of_its_own():
    guided = guidance(Waypoint(0.0, 0.0, 1.0, 0.0, 0.0))
    guided.flying = False
    assert place(guided.step(STEP_NS, pose(*ORIGIN), None)) == ORIGIN
    guided.flying = True
    begun = place(guided.step(2 * STEP_NS, pose(10.3, -5.0, 1.4), None))
    assert math.dist(begun, (10.3, -5.0, 1.4)) < 0.1
    later = place(guided.step(3 * STEP_NS, pose(10.3, -5.0, 0.9), None))
    assert math.dist(later, begun) < 0.2  # from then on the point leads


def test_it_does_not_begin_where_a_pose_has_jumped_to():
    guided = guidance(Waypoint(0.0, 0.0, 1.0, 0.0, 0.0))
    jumped = guided.step(STEP_NS, pose(17.0, -5.0, 1.4), None)
    assert (jumped.type_mask, guided.still) == (BY_VELOCITY, False)
    assert math.dist(place(guided.step(2 * STEP_NS, pose(10.0, -5.0, 1.4), None)), (10.0, -5.0, 1.4)) < 0.1


def test_told_to_go_on_before_it_stood_still_it_goes_on_from_where_it_is():
    guided = guidance(Waypoint(0.0, 9.0, 1.0, 0.0, 0.0))
    guided.step(STEP_NS, pose(*ORIGIN), None)
    guided.stand()
    guided.step(2 * STEP_NS, pose(10.0, -5.0, 1.0, speed=1.0), None)
    guided.go_on()
    assert math.dist(place(guided.step(3 * STEP_NS, pose(10.0, -5.0, 1.4), None)), (10.0, -5.0, 1.4)) < 0.1


def test_told_to_stand_it_stops_and_then_stays_there():
    guided = guidance(Waypoint(0.0, 9.0, 1.0, 0.0, 0.0))
    guided.stand()
    moving = guided.step(S, pose(10.0, -3.0, 1.5, speed=1.0), None)
    assert (moving.type_mask, guided.still, guided.standing) == (BY_VELOCITY, False, True)
    still = guided.step(S + STEP_NS, pose(10.0, -2.5, 1.5, speed=0.1), None)
    assert (place(still), guided.still) == ((10.0, -2.5, 1.5), True)
    drifted = guided.step(S + 2 * STEP_NS, pose(10.3, -2.5, 1.5, speed=0.5), None)
    assert place(drifted) == (10.0, -2.5, 1.5)
    guided.go_on()
    assert (guided.still, guided.standing) == (False, False)
    on = place(guided.step(S + 3 * STEP_NS, pose(10.0, -2.5, 1.5), None))
    assert math.dist(on, (10.0, -2.5, 1.5)) < 0.1


def test_where_it_stands_a_pose_that_jumps_is_not_flown_back_from():
    guided = guidance(Waypoint(0.0, 9.0, 1.0, 0.0, 0.0))
    guided.stand()
    assert place(guided.step(S, pose(10.0, -2.5, 1.5), None)) == (10.0, -2.5, 1.5)
    for t_ns in (2 * S, 3 * S):
        jumped = guided.step(t_ns, pose(17.0, -2.5, 1.5), None)
        assert (jumped.type_mask, guided.blind_ns(t_ns), guided.still) == (BY_VELOCITY, t_ns - S, True)
    assert place(guided.step(4 * S, pose(10.2, -2.5, 1.5), None)) == (10.0, -2.5, 1.5)
    assert guided.blind_ns(4 * S) == 0


def test_every_set_point_names_its_vehicle():
    message = guidance(Waypoint(0.0, 0.0, 1.0, 0.0, 0.0)).step(S, None, None)
    assert (message.target_system, message.target_component) == TARGET
