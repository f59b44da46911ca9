"""`Stepper`: what `decide` does, several times faster for those who feed very many events.

Most events of a flight say again what is known already: a heartbeat, a position a little further on. They change a
time stamp and a stored status, and nothing comes of them. The stepper sees that such an event cannot do more, makes the
state that `decide` would make, and leaves the table alone; everything else goes to `decide`. Why that is exact:

* It knows only the state that it made last, and only while that is *settled*: `decide` has just tried every row on it,
  and none held; what is wrong was the same before and after, and says nothing of how long it has lasted.
* An event is *quiet* when all that rows, failures and limits look at in it is as in the last one of its kind
  (`_QUIET`, one function for each status, in the order of `absorb.py`). Its stream must be fresh: the first word after
  silence is news.
* Until the *horizon* no comparison with the time comes out otherwise than before (`horizon.py`): no timer ends, nothing
  grows too old. Quiet events move stamps on, never back, so a horizon only moves on, too; where a status brings an age
  of its own (link, battery), its end counts as well.

So rows, failures and limits would look at the same values with the same outcome. test/engine/test_stepper.py lets both
decide every story of the tests, and random ones; test_stepper_news.py and test_stepper_times.py say of each field and
of each limit whether the table must be asked.
"""

from __future__ import annotations

from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Type

from .absorb import proves_recording
from .commands import Command
from .decide import decide
from .events import (
    AutopilotStatus,
    ComponentStatus,
    Event,
    LandedStatus,
    MissionStatus,
    RecordingPhase,
    RecordingStatus,
    Tick,
    VehicleLanded,
    WatchdogAction,
    WatchdogInfo,
)
from .horizon import Horizon
from .modes import MODES, ours
from .rules import Rules
from .severity import Code
from .state import EngineState, FailureKind, State, evolve

__all__ = ["Stepper"]

_NS = 1_000_000_000
_SURE = 1.0 - 1e-9  # a square this much below that of a limit has a root below the limit
Changes = Optional[Dict[str, Any]]


class Stepper:
    """Decides one event after the other.

    Args:
        rules: the configuration.
    """

    def __init__(self, rules: Rules) -> None:
        self.rules, self.limits = rules, rules.limits
        self.horizon_ns = 0
        self._horizon: Optional[Horizon] = None
        self.calm = self._components = _NONE
        self.told: Tuple[Tuple[ComponentStatus, ...], Tuple[ComponentStatus, ...]] = ((), ())
        self._settled: Optional[EngineState] = None

    def decide(self, state: EngineState, event: Event) -> Tuple[EngineState, Tuple[Command, ...]]:
        """Return what `decide.decide` returns."""
        if state is self._settled:
            quiet = _QUIET.get(type(event))
            if quiet is not None and self._before_horizon(state, event.t_ns):
                changes = quiet(self, state, event)
                if changes is not None:
                    changes["t_ns"] = event.t_ns
                    self._settled = after = evolve(state, **changes)
                    return after, ()
        after, commands = decide(state, event, self.rules)
        self._settle(state, event, after, commands)
        return after, commands

    def wakes_ns(self, state: EngineState, t_ns: int = 0) -> int:
        """Return a time that `timers.next_deadline` of a state does not come before; 0 when nothing is known.

        Args:
            state: the one that was made last.
            t_ns: look again when the time that was found last is not behind this one.
        """
        if state is not self._settled:
            return 0
        if self.horizon_ns <= t_ns:
            self._look_ahead(state)
        return self.horizon_ns

    def _before_horizon(self, state: EngineState, t_ns: int) -> bool:
        if t_ns >= self.horizon_ns:
            self._look_ahead(state)
        return state.t_ns <= t_ns < self.horizon_ns

    def _look_ahead(self, state: EngineState) -> None:
        if self._horizon is None:
            self._horizon = Horizon(state, self.rules)
        self.horizon_ns = self._horizon.after(state)

    def _settle(self, state: EngineState, event: Event, after: EngineState, commands: Tuple[Command, ...]) -> None:
        """See whether the state that `decide` made is settled."""
        self._settled, self._horizon, self.horizon_ns = None, None, 0
        if commands or not isinstance(event, _SETTLING) or not _same_failures(state, after):
            return
        self._settled = after
        if self._components is not after.components:
            self._components = after.components
            self.calm = after.components if _is_calm(after.components) else _NONE
        if isinstance(event, WatchdogInfo):
            self.told = event.components, after.components


_SETTLING = (AutopilotStatus, LandedStatus, MissionStatus, RecordingStatus, Tick, WatchdogAction, WatchdogInfo)
_NONE: Tuple[ComponentStatus, ...] = (ComponentStatus(name="", code=Code.ABORT),)  # those of no state


def _same_failures(before: EngineState, after: EngineState) -> bool:
    """Return True when what is wrong is as before, and its words do not tell how long it has lasted."""
    return (
        before.failures == after.failures
        and before.spent == after.spent
        and before.flown_without == after.flown_without
        and not any(failure.kind is FailureKind.LOSS for failure in after.failures)
    )


def _is_calm(components: Tuple[ComponentStatus, ...]) -> bool:
    """Return True when an action stream that lists nothing leaves the components as they are."""
    names: List[str] = [status.name for status in components]
    return names == sorted(names) and all(status.code < Code.INCONVENIENT for status in components)


def _fresh(now_ns: int, since_ns: Optional[int], limit_ns: int) -> bool:
    return since_ns is not None and now_ns - since_ns <= limit_ns


def _credible(stepper: Stepper, age_ns: int) -> bool:
    return -stepper.limits.clock_tolerance_ns <= age_ns <= stepper.limits.status_max_age_ns


def _watchdog_action(stepper: Stepper, state: EngineState, event: WatchdogAction) -> Changes:
    """It lists nothing, as before."""
    last = state.action
    if not _credible(stepper, event.age_ns):
        return {}
    if last is None or event.components or event.code >= Code.INCONVENIENT or state.components is not stepper.calm:
        return None
    if event.loop_counter == last.loop_counter:
        return {"action": event}
    if not _fresh(event.t_ns, state.heartbeat_ns, stepper.limits.watchdog_heartbeat_limit_ns):
        return None
    return {"action": event, "heartbeat_ns": event.t_ns}


def _watchdog_info(stepper: Stepper, state: EngineState, event: WatchdogInfo) -> Changes:
    """It tells of the components what it told before."""
    told, became = stepper.told
    same = state.components is stepper.calm and event.components == told and state.components == became
    return {} if same or not _credible(stepper, event.age_ns) else None


def _mission_status(stepper: Stepper, state: EngineState, event: MissionStatus) -> Changes:
    """The planner is in the same phase, at the same waypoint."""
    last, t_ns, since_ns = state.planner, event.t_ns, state.planner_ns
    if not event.session_id or event.session_id != state.session_id or not _credible(stepper, event.age_ns):
        return {}
    if (
        last is None
        or event.phase is not last.phase
        or event.waypoint != last.waypoint
        or event.waypoints != last.waypoints
        or event.mission_id != last.mission_id
        or event.file_index != last.file_index
        or event.repetition != last.repetition
        or event.message != last.message
        or last.t_ns <= state.motion_ns
        or since_ns is None
        or t_ns - since_ns > stepper.limits.planner_status_limit_ns
    ):
        return None
    return {"planner": event, "planner_ns": t_ns}


def _recording_status(stepper: Stepper, state: EngineState, event: RecordingStatus) -> Changes:
    """The recorder is in the same phase, and the same files grow."""
    last, t_ns = state.recorder, event.t_ns
    if not event.session_id or event.session_id != state.session_id or not _credible(stepper, event.age_ns):
        return {}
    if (
        last is None
        or event.phase is not last.phase
        or event.phase is RecordingPhase.FAILED  # for how long counts
        or event.message != last.message
        or (event.location and event.location != state.data_location)
        or not state.recording_progressed
        or (state.recording_since_ns is not None) is not proves_recording(event)
        or not _fresh(t_ns, state.recorder_ns, stepper.limits.recorder_status_limit_ns)
    ):
        return None
    platforms = [(each.platform, each.growing) for each in event.platforms]
    same = platforms == [(each.platform, each.growing) for each in last.platforms]
    return {"recorder": event, "recorder_ns": t_ns} if same else None


def _landed_status(stepper: Stepper, state: EngineState, event: LandedStatus) -> Changes:
    """The landing detection judges as before."""
    last, t_ns, since_ns = state.landing, event.t_ns, state.landing_ns
    if not _credible(stepper, event.age_ns):
        return {}
    if last is None or event.landed is not last.landed or since_ns is None:
        return None
    if t_ns - since_ns > stepper.limits.landing_detection_limit_ns:
        return None
    return {"landing": event, "landing_ns": t_ns}


def _autopilot_status(stepper: Stepper, state: EngineState, event: AutopilotStatus) -> Changes:
    """The vehicle is in the same condition, and within all limits."""
    last, t_ns, limits = state.autopilot, event.t_ns, stepper.limits
    if not _credible(stepper, event.age_ns):
        return {}
    if (
        last is None
        or event.armed is not last.armed
        or event.landed is not last.landed
        or event.mode != last.mode
        or event.pilot_in_control is not last.pilot_in_control
        or event.failsafe is not last.failsafe
        or event.battery_critical is not last.battery_critical
        or event.link_age_s is None
        or last.link_age_s is None
        or state.armed_at_start is None
        or not _fresh(t_ns, state.autopilot_ns, limits.autopilot_status_limit_ns)
        or not _is_kept(state, event)
        or not _within_limits(stepper, state, event, last)
    ):
        return None
    link_ns, limit_ns = t_ns - int(event.link_age_s * _NS), limits.autopilot_link_limit_ns
    linked_ns = (state.autopilot_ns or 0) - int(last.link_age_s * _NS)
    if not _fresh(t_ns, link_ns, limit_ns) or not _fresh(t_ns, linked_ns, limit_ns):
        return None
    changes: Dict[str, Any] = {"autopilot": event, "autopilot_ns": t_ns}
    stepper.horizon_ns = min(stepper.horizon_ns, link_ns + limit_ns + 1)
    return changes if _battery(stepper, state, event, changes) and _position(stepper, state, event, changes) else None


def _is_kept(state: EngineState, event: AutopilotStatus) -> bool:
    """Return True when flight and flight mode are followed already as far as this status leads."""
    if event.armed is False and event.landed is VehicleLanded.ON_GROUND:
        return state.grounded_ns is not None and not state.in_flight
    if event.armed is not True or event.landed in (VehicleLanded.ON_GROUND, VehicleLanded.UNKNOWN):
        return False
    if state.grounded_ns is not None or state.disarm_sent_ns is not None:
        return False
    if not state.in_flight:
        return state.state is not State.LAND  # in other hands: no flight of ours goes on
    if not (state.was_armed and state.was_airborne and state.flown):
        return False
    commanded, confirmed = state.commanded, state.confirmed
    if commanded and event.mode in MODES[commanded[-1]]:
        return confirmed is commanded[-1] and len(commanded) == 1
    return ours(event.mode, commanded, confirmed)


def _within_limits(stepper: Stepper, state: EngineState, event: AutopilotStatus, last: AutopilotStatus) -> bool:
    """Return True when height, distance, battery and descent say nothing new."""
    limits, mission = stepper.limits, state.mission
    highest, farthest = limits.max_height_m, limits.max_distance_m
    if mission is not None:
        highest = highest if mission.max_height_m is None else mission.max_height_m
        farthest = farthest if mission.max_distance_m is None else mission.max_distance_m
    height, height_before, takeoff = event.height_m, last.height_m, limits.takeoff_height_m
    if height is not None and height > highest:
        return False
    if (height is not None and height >= takeoff) is not (height_before is not None and height_before >= takeoff):
        return False
    x_m, y_m = event.position_x_m, event.position_y_m
    if x_m is not None and y_m is not None and not x_m * x_m + y_m * y_m < farthest * farthest * _SURE:
        return False
    if event.battery_fraction is not None and event.battery_fraction <= limits.battery_critical_fraction:
        return False
    if event.battery_critical:
        return False
    speed = event.vertical_speed_m_s
    return (speed is not None and speed <= -limits.descent_speed_m_s) is (state.descending_ns is not None)


def _battery(stepper: Stepper, state: EngineState, event: AutopilotStatus, changes: Dict[str, Any]) -> bool:
    """Move on when the battery was heard; return False when that is news."""
    age_s = event.battery_age_s
    if event.battery_fraction is None or age_s is None:
        return True
    heard_ns, limit_ns = max(0, event.t_ns - int(age_s * _NS)), stepper.limits.battery_age_limit_ns
    if not _fresh(event.t_ns, state.battery_ns, limit_ns) or not _fresh(event.t_ns, heard_ns, limit_ns):
        return False
    changes["battery_ns"] = heard_ns
    stepper.horizon_ns = min(stepper.horizon_ns, heard_ns + limit_ns + 1)
    return True


def _position(stepper: Stepper, state: EngineState, event: AutopilotStatus, changes: Dict[str, Any]) -> bool:
    """Move on when the position was known; return False when that is news."""
    if None in (event.height_m, event.position_x_m, event.position_y_m):
        return True
    changes["position_ns"] = event.t_ns
    return _fresh(event.t_ns, state.position_ns, stepper.limits.position_age_limit_ns)


_QUIET: Mapping[Type[Event], Callable[[Stepper, EngineState, Any], Changes]] = {
    AutopilotStatus: _autopilot_status,
    LandedStatus: _landed_status,
    MissionStatus: _mission_status,
    RecordingStatus: _recording_status,
    WatchdogAction: _watchdog_action,
    WatchdogInfo: _watchdog_info,
}
"""By kind of status: what a quiet one changes; None: it may be news."""
