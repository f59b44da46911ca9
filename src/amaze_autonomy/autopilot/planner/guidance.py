"""Set-points along waypoints in the local frame, for a vehicle without a position on the earth. Pure.

A point runs ahead of the vehicle along each leg, as fast as the flight model says, and waits when the vehicle does not
follow: a set-point that jumped to the next waypoint would be flown to as fast as the autopilot can. Without a fresh
pose, and with one that has jumped, the set-point is to stand still: velocity zero. Each call gives one message,
whatever is known: the stream never depends on anything.

The point begins where the vehicle is when it first follows: an ArduPilot has climbed by itself until then, and a point
that was still on the ground would be descended to.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.missions import FlightModel, PlannerSpec, Waypoint

from ..link.dialect import Message, mavlink
from .mission_vehicle import Pose

_S = 1_000_000_000
Vector = Tuple[float, float, float]

_FRAME = mavlink.MAV_FRAME_LOCAL_NED
_NO_POSITION, _NO_VELOCITY, _NO_ACCELERATION, _NO_YAW, _NO_YAW_RATE = 0x7, 0x38, 0x1C0, 0x400, 0x800
_BY_POSITION = _NO_VELOCITY | _NO_ACCELERATION | _NO_YAW_RATE
_BY_VELOCITY = _NO_POSITION | _NO_ACCELERATION | _NO_YAW | _NO_YAW_RATE
_LONGEST_STEP_S = 0.2  # at 10 Hz a step is 0.1 s, and half as much again when the link looks at the time late
_STILL_M_S = 0.2
_LEAST_LEAD_M = 1.0
_LEAD_S = 1.5
_FAR_LEADS = 2.0  # further from its point than so many leads the vehicle is not where its pose says
_THERE_M = 1e-6


class Climb(NamedTuple):
    """The climb of a takeoff, in metres above where it takes off.

    Args:
        goal_m: where the point leads; above the height that is waited for, since no vehicle hovers exactly.
        over_m: the climb is over here, and not below.
    """

    goal_m: float
    over_m: float


class Guidance:
    """Leads the vehicle up, along the waypoints, and on to the end of the last hold.

    Args:
        waypoints: of one file, east and north of the origin, heights above where it takes off.
        origin: position of the mission's first takeoff in the estimator's frame (ENU).
        climb: how high it leads, and when that is over.
        model: speeds.
        spec: radius, tolerance, limits.
        pose: where it takes off.
        yaw_rad: likewise; None: unknown.
        target: system and component of the vehicle.
    """

    def __init__(
        self,
        waypoints: Sequence[Waypoint],
        origin: Vector,
        climb: Climb,
        model: FlightModel,
        spec: PlannerSpec,
        pose: Pose,
        yaw_rad: Optional[float],
        target: Tuple[int, int],
    ) -> None:
        self.origin, self._target = (origin[0], origin[1], pose.position_m[2]), target  # as a mission's: above home
        self._over_the_ground_m = climb.over_m
        self._model, self._spec = model, spec
        start = Waypoint(pose.position_m[0] - origin[0], pose.position_m[1] - origin[1], climb.goal_m, 0.0, 0.0)
        self._yaw = waypoints[0].yaw_rad if yaw_rad is None else yaw_rad
        self._goals = (_with_yaw(start, self._yaw), *waypoints)
        self._number = 0  # of the goals; 0 is the climb
        self._at: Vector = pose.position_m
        self._speed = 0.0
        self._t_ns: Optional[int] = None
        self._leave_ns: Optional[int] = None
        self._standing = False
        self._stay: Optional[Vector] = None
        self._fresh_ns: Optional[int] = None
        self._begun = False  # the point is where the vehicle was when it followed first
        self.flying = False

    @property
    def reached(self) -> int:
        """How many waypoints are done with."""
        return max(0, self._number - 1)

    @property
    def finished(self) -> bool:
        """True after the last hold."""
        return self._number >= len(self._goals)

    @property
    def climbing(self) -> bool:
        """True until it is at takeoff height."""
        return self._number == 0

    @property
    def standing(self) -> bool:
        """True while it stops or stands because it was told to."""
        return self._standing

    @property
    def still(self) -> bool:
        """True once it stands still because it was told to."""
        return self._stay is not None

    def stands_at(self, pose: Pose) -> None:
        """Take the height at which it stands before it lifts off: heights count from there."""
        self.origin = (*self.origin[:2], pose.position_m[2])
        self._at = (*self._at[:2], pose.position_m[2])

    def stand(self) -> None:
        """Stop, and stay there."""
        if not self._standing:
            self._standing, self._stay, self._leave_ns = True, None, None

    def go_on(self) -> None:
        """Fly on to the waypoint that was interrupted."""
        if self._standing:
            self._standing, self._speed = False, 0.0
            self._at, self._begun = self._stay or self._at, self._stay is not None
            self._stay = None

    def blind_ns(self, t_ns: int) -> int:
        """Return for how long there has been no fresh pose."""
        return 0 if self._fresh_ns is None else t_ns - self._fresh_ns

    def step(self, t_ns: int, pose: Optional[Pose], yaw_rad: Optional[float]) -> Message:
        """Return the set-point of this moment.

        Args:
            t_ns: now.
            pose: None when there is no fresh and valid one.
            yaw_rad: None when unknown.
        """
        passed_s = 0.0 if self._t_ns is None else min(_LONGEST_STEP_S, (t_ns - self._t_ns) / _S)
        self._t_ns = t_ns
        if pose is not None and self.flying and not (self._begun or self._standing):
            self._begin(pose)
        if pose is not None and self._is_far(pose):
            pose = None  # a jump of the estimate: to follow it would be to fly away
        if self._fresh_ns is None or pose is not None:
            self._fresh_ns = t_ns
        if pose is None:
            self._speed = 0.0
            return self._stop()
        if self._standing:
            return self._stand(pose)
        if self.flying and not self.finished:
            self._lead(passed_s, pose)
            self._arrive(t_ns, pose, yaw_rad)
        return self._point(self._at)

    # --- the point that runs ahead --------------------------------------------------------------------------------

    def _begin(self, pose: Pose) -> None:
        """Have the point begin where the vehicle is, unless that is far from its way: then the estimate has jumped."""
        self._begun = math.dist(_nearest(self._at, self._goal()[0], pose.position_m), pose.position_m) <= self._far_m
        if self._begun:
            self._at = pose.position_m

    def _goal(self) -> Tuple[Vector, Waypoint]:
        goal = self._goals[min(self._number, len(self._goals) - 1)]
        x, y, z = self.origin
        return (x + goal.x_m, y + goal.y_m, z + goal.z_m), goal

    def _lead(self, passed_s: float, pose: Pose) -> None:
        """Move the point towards the goal, and turn."""
        goal, waypoint = self._goal()
        turn = _angle(waypoint.yaw_rad - self._yaw)
        most = self._model.turn_rate_rad_s * passed_s
        self._yaw += min(most, max(-most, turn))
        way = math.dist(self._at, goal)
        fastest = self._fastest(self._at, goal, way)
        if math.dist(self._at, pose.position_m) > self._longest_lead(fastest):
            self._speed = 0.0
            return
        brake = math.sqrt(2.0 * self._model.acceleration_m_s2 * way)
        self._speed = min(fastest, brake, self._speed + self._model.acceleration_m_s2 * passed_s)
        part = 1.0 if way <= _THERE_M else min(1.0, self._speed * passed_s / way)
        if way < 0.01:  # noqa: PLR2004 - metres; a brake that ends in zero never arrives
            part = 1.0
        x, y, z = (at + part * (to - at) for at, to in zip(self._at, goal))
        self._at = (x, y, z)

    def _is_far(self, pose: Pose) -> bool:
        place = self._stay if self._standing else self._at
        if not self.flying or place is None:
            return False  # while it stops nobody knows where it comes to stand
        return math.dist(place, pose.position_m) > self._far_m

    @property
    def _far_m(self) -> float:
        """Return how far from its point a vehicle is that has not been led there, whichever way the leg goes."""
        model = self._model
        fastest = max(model.cruise_speed_m_s, model.climb_speed_m_s, model.descent_speed_m_s)
        return _FAR_LEADS * self._longest_lead(fastest) + self._spec.acceptance_radius_m

    @staticmethod
    def _longest_lead(speed_m_s: float) -> float:
        return max(_LEAST_LEAD_M, _LEAD_S * speed_m_s)

    def _fastest(self, start: Vector, goal: Vector, way: float) -> float:
        if way <= _THERE_M:
            return self._model.cruise_speed_m_s
        across = math.hypot(goal[0] - start[0], goal[1] - start[1]) / way
        up = (goal[2] - start[2]) / way
        vertical = self._model.climb_speed_m_s if up > 0 else self._model.descent_speed_m_s
        limits = [self._model.cruise_speed_m_s / across] if across > _THERE_M else []
        limits += [vertical / abs(up)] if abs(up) > _THERE_M else []
        return min(limits)

    def _arrive(self, t_ns: int, pose: Pose, yaw_rad: Optional[float]) -> None:
        goal, waypoint = self._goal()
        if self._leave_ns is None:
            turned = yaw_rad is None or abs(_angle(waypoint.yaw_rad - yaw_rad)) <= self._spec.heading_tolerance_rad
            near = math.dist(pose.position_m, goal) <= self._spec.acceptance_radius_m
            near = near and (not self.climbing or pose.position_m[2] >= self.origin[2] + self._over_the_ground_m)
            if not (near and turned and math.dist(self._at, goal) <= _THERE_M):
                return
            self._leave_ns = t_ns + round(waypoint.hold_s * _S)
        if t_ns >= self._leave_ns:
            self._number, self._leave_ns, self._speed = self._number + 1, None, 0.0

    # --- messages -------------------------------------------------------------------------------------------------

    def _stand(self, pose: Pose) -> Message:
        if self._stay is None and pose.speed_m_s < _STILL_M_S:
            self._stay = pose.position_m
        return self._stop() if self._stay is None else self._point(self._stay)

    def _stop(self) -> Message:
        return self._message(_BY_VELOCITY, (0.0, 0.0, 0.0), 0.0)

    def _point(self, place: Vector) -> Message:
        return self._message(_BY_POSITION, place, _angle(math.pi / 2 - self._yaw))

    def _message(self, mask: int, enu: Vector, yaw_ned_rad: float) -> Message:
        place = (enu[1], enu[0], -enu[2])
        still = (0.0,) * 6  # velocity and acceleration
        return mavlink.MAVLink_set_position_target_local_ned_message(
            0, *self._target, _FRAME, mask, *place, *still, yaw_ned_rad, 0.0
        )


def _nearest(start: Vector, end: Vector, place: Vector) -> Vector:
    """Return the point of a way that is nearest to a place."""
    way = [to - at for at, to in zip(start, end)]
    long = sum(each * each for each in way)
    part = sum(each * (there - at) for each, at, there in zip(way, start, place)) / long if long else 0.0
    x, y, z = (at + min(1.0, max(0.0, part)) * each for at, each in zip(start, way))
    return (x, y, z)


def _with_yaw(waypoint: Waypoint, yaw_rad: float) -> Waypoint:
    return Waypoint(waypoint.x_m, waypoint.y_m, waypoint.z_m, yaw_rad, waypoint.hold_s)


def _angle(value: float) -> float:
    """Return an angle within half a turn."""
    return math.remainder(value, 2 * math.pi)
