"""The scripted world of a replay: planner, recorder and vehicle, as far as no bag tells. Nothing ever fails here.

It is open loop: the recorded vehicle does not do what the engine says. The script does what a working peer would do at
once, so that the engine goes on; what the recording tells takes the place of what the script would have said.
"""

from __future__ import annotations

from typing import Any, Dict, Mapping, Optional, Tuple

from amaze_autonomy.engine.commands import LoadMission, MissionAction, StartRecording, StopRecording
from amaze_autonomy.engine.events import (
    MissionPhase,
    MissionStatus,
    PlatformRecording,
    RecordingPhase,
    RecordingStatus,
    UserCommand,
    VehicleLanded,
)
from amaze_autonomy.engine.state import EngineState, OutreachKind, State

from ..beginning import Lead
from ..maps.topic_map import Script

_S = 1_000_000_000
_ARM_NS, _LIFT_NS, _CLIMB_M_S = _S // 2, 1 * _S, 1.0
_CRUISE_M, _DISARM_NS = 2.0, _S // 2
_TOUCH_M, _HOVER_M = 0.05, 0.3
_MODES: Dict[MissionAction, str] = {
    MissionAction.TAKEOFF: "AUTO.MISSION",
    MissionAction.RESUME: "AUTO.MISSION",
    MissionAction.HOLD: "AUTO.LOITER",
    MissionAction.LAND: "AUTO.LAND",
    MissionAction.ABORT: "AUTO.LAND",
}


class Vehicle:
    """A vehicle that does at once what it is told: it arms, climbs, flies, descends and disarms.

    Args:
        lead: before a recording that begins in the air: it climbs to where that begins, and stays there.
    """

    def __init__(self, lead: Optional[Lead] = None) -> None:
        self._lead = lead
        self.mode = "AUTO.LOITER"
        self._turning_ns: Optional[int] = None
        self._takeoff_ns: Optional[int] = None
        self._land_ns: Optional[int] = None
        self._land_height_m = 0.0
        self._down_ns: Optional[int] = None
        self._flew = self._disarmed = False

    def command(self, t_ns: int, action: MissionAction) -> None:
        """Do what the planner or the autopilot was told."""
        self.mode = _MODES[action]
        if action is MissionAction.TAKEOFF:
            if self._lead is not None and t_ns < self._lead.end_ns:
                self.mode = "AUTO.TAKEOFF"  # the recording says in which mode its mission is flown
            self._takeoff_ns, self._land_ns, self._down_ns = t_ns, None, None
            self._flew = self._disarmed = False
            self._turning_ns = None
        elif action in (MissionAction.LAND, MissionAction.ABORT) and self._land_ns is None:
            self._land_height_m = self._height_m(t_ns)
            self._land_ns = t_ns

    def facts(self, t_ns: int, told: Mapping[str, Any]) -> Dict[str, Any]:
        """Return the whole of what the vehicle says: what the recording tells, the rest as scripted.

        Args:
            t_ns: now.
            told: by the recording, fields of AutopilotStatus; what it should tell and does not is unknown.
        """
        self._hear_motors(t_ns, told)
        landed = told["landed"] if "landed" in told else self._landed_with(t_ns, told)
        if landed is not VehicleLanded.ON_GROUND:
            self._down_ns, self._flew = None, self._flew or landed is not VehicleLanded.UNKNOWN
        elif self._down_ns is None:
            self._down_ns = t_ns
        return {
            "armed": told["armed"] if "armed" in told else self._armed(t_ns),
            "landed": landed or VehicleLanded.UNKNOWN,
            "height_m": told["height_m"] if "height_m" in told else self._height_with(t_ns, landed),
            "battery_fraction": told.get("battery_fraction", 0.95),
            "battery_voltage_v": told.get("battery_voltage_v"),
        }

    def height_m(self, t_ns: int) -> float:
        """Return how high it is, as far as the script alone says."""
        return self._height_m(t_ns)

    def _hear_motors(self, t_ns: int, told: Mapping[str, Any]) -> None:
        """Take when the recorded motors began to turn after the takeoff was commanded: it lifts off after that."""
        if self._takeoff_ns is not None and self._turning_ns is None and told.get("armed") is True:
            self._turning_ns = t_ns

    def _landed_with(self, t_ns: int, told: Mapping[str, Any]) -> VehicleLanded:
        """Return where the scripted vehicle is, as far as recorded motors allow: none flies disarmed or rests armed."""
        landed = self._landed(t_ns)
        if told.get("armed") is False:
            return VehicleLanded.ON_GROUND
        if told.get("armed") is True and landed is VehicleLanded.ON_GROUND and self._flew:
            return VehicleLanded.LANDING
        return landed

    def _height_with(self, t_ns: int, landed: Optional[VehicleLanded]) -> float:
        """Return how high the scripted vehicle is; on the ground it is at 0, and above it where it is said to fly."""
        if landed is VehicleLanded.ON_GROUND:
            return 0.0
        height_m = self._height_m(t_ns)
        return max(_HOVER_M, height_m) if landed in (VehicleLanded.IN_AIR, VehicleLanded.LANDING) else height_m

    def _height_m(self, t_ns: int) -> float:
        if self._land_ns is not None:
            return max(0.0, self._land_height_m - _CLIMB_M_S * (t_ns - self._land_ns) / _S)
        if self._takeoff_ns is None:
            return 0.0
        if self._lead is not None and self._takeoff_ns < self._lead.end_ns:
            return self._lead.height_at(t_ns, self._takeoff_ns + _LIFT_NS)
        lift_ns = max(self._takeoff_ns + _LIFT_NS, (self._turning_ns or self._takeoff_ns) + _ARM_NS)
        return min(_CRUISE_M, max(0.0, _CLIMB_M_S * (t_ns - lift_ns) / _S))

    def _landed(self, t_ns: int) -> VehicleLanded:
        height = self._height_m(t_ns)
        if height <= _TOUCH_M:
            return VehicleLanded.ON_GROUND
        return VehicleLanded.LANDING if self._land_ns is not None else VehicleLanded.IN_AIR

    def _armed(self, t_ns: int) -> bool:
        """Return True from a moment after the takeoff command until a moment after the landing, and not again."""
        if self._takeoff_ns is None or t_ns < self._takeoff_ns + _ARM_NS:
            return False
        landing = self._land_ns is not None or self._flew
        if landing and self._down_ns is not None and t_ns >= self._down_ns + _DISARM_NS:
            self._disarmed = True
        return not self._disarmed


class Planner:
    """A planner that accepts everything; its phase is that of the vehicle, whose landing is its one waypoint."""

    def __init__(self) -> None:
        self.phase, self._waypoint = MissionPhase.IDLE, 0
        self._loaded = LoadMission(id=0, limit_ns=1, session_id="", mission_id="", file_index=0, repetition=0)

    def load(self, command: LoadMission) -> None:
        """Take a waypoint file."""
        self._loaded, self.phase, self._waypoint = command, MissionPhase.LOADED, 0

    def command(self, action: MissionAction) -> None:
        """Carry out a command."""
        phases = {
            MissionAction.TAKEOFF: MissionPhase.TAKING_OFF,
            MissionAction.HOLD: MissionPhase.HOLDING,
            MissionAction.RESUME: MissionPhase.FLYING,
        }
        self.phase = phases.get(action, MissionPhase.LANDING)

    def follow(self, facts: Mapping[str, Any], takeoff_height_m: float) -> None:
        """Read the phase from the vehicle."""
        down = facts["landed"] is VehicleLanded.ON_GROUND
        airborne = not down and facts["landed"] is not VehicleLanded.UNKNOWN
        if self.phase is MissionPhase.TAKING_OFF and airborne and (facts["height_m"] or 0.0) >= takeoff_height_m:
            self.phase = MissionPhase.FLYING
        elif self.phase in (MissionPhase.FLYING, MissionPhase.HOLDING) and down:
            self.phase, self._waypoint = MissionPhase.LANDING, 1  # the recorded vehicle has landed
        elif self.phase is MissionPhase.LANDING and down and facts["armed"] is False:
            self.phase = MissionPhase.LANDED

    def status(self, t_ns: int) -> MissionStatus:
        """Return the status at a time."""
        loaded = self._loaded
        return MissionStatus(
            t_ns=t_ns,
            session_id=loaded.session_id,
            mission_id=loaded.mission_id,
            phase=self.phase,
            file_index=loaded.file_index,
            repetition=loaded.repetition,
            waypoint=self._waypoint,
            waypoints=1,
        )


class Recorder:
    """A data recorder whose files grow, and whose data is complete a second after it was told to stop."""

    _STARTS_NS, _MERGES_NS = _S // 2, 1 * _S

    def __init__(self) -> None:
        self._session = ""
        self._started_ns: Optional[int] = None
        self._stopped_ns: Optional[int] = None

    def start(self, t_ns: int, command: StartRecording) -> None:
        """Start."""
        self._session, self._started_ns, self._stopped_ns = command.session_id, t_ns, None

    def stop(self, t_ns: int, command: StopRecording) -> None:
        """Stop, and go on to the complete recording."""
        self._session, self._stopped_ns = command.session_id, t_ns

    def status(self, t_ns: int) -> RecordingStatus:
        """Return the status at a time."""
        phase, growing = self._phase(t_ns)
        complete = phase is RecordingPhase.COMPLETE
        return RecordingStatus(
            t_ns=t_ns,
            session_id=self._session,
            phase=phase,
            progress=1.0 if complete else None,
            platforms=(PlatformRecording("script", growing, self._written(t_ns)),) if self._session else (),
            location="script" if complete else "",
        )

    def _phase(self, t_ns: int) -> Tuple[RecordingPhase, bool]:
        if self._stopped_ns is not None:
            done = t_ns >= self._stopped_ns + self._MERGES_NS
            return (RecordingPhase.COMPLETE if done else RecordingPhase.MERGING), False
        if self._started_ns is None:
            return RecordingPhase.IDLE, False
        recording = t_ns >= self._started_ns + self._STARTS_NS
        return (RecordingPhase.RECORDING if recording else RecordingPhase.STARTING), recording

    def _written(self, t_ns: int) -> int:
        end = t_ns if self._stopped_ns is None else self._stopped_ns
        return 0 if self._started_ns is None else max(0, end - self._started_ns) // 1000


# --- user -------------------------------------------------------------------------------------------------------------
# The scripted user of a replay: selects the mission, gives the go, retries, gives up, acknowledges.


_THINKS_NS = 1_000_000_000


class User:
    """Answers what the engine asks a person for, each time it asks.

    Args:
        script: how often and after how long.
    """

    def __init__(self, script: Script) -> None:
        self._script = script
        self._retries = script.retries
        self._asked: Tuple[State, int] = (State.MISSION_INPUT, -1)

    def react(self, state: EngineState, *, require_go: bool) -> Optional[Tuple[int, UserCommand]]:
        """Return what the user will ask and when; None: nothing new."""
        asked = (state.state, state.entered_ns)
        if asked == self._asked:
            return None
        self._asked = asked
        if state.state is State.OUTREACH:
            return self._outreach(state)
        if state.state is State.PILOT:
            return state.t_ns + self._script.retry_after_ns, UserCommand.ACKNOWLEDGE
        if state.state is State.READY and require_go:
            return state.t_ns + _THINKS_NS, UserCommand.GO
        return None

    def again(self, state: EngineState, command: UserCommand) -> Optional[int]:
        """Return when the user asks the same again, because it was refused; None: never."""
        waits = command is UserCommand.ACKNOWLEDGE and state.state is State.PILOT
        return state.t_ns + self._script.retry_after_ns if waits else None

    def _outreach(self, state: EngineState) -> Tuple[int, UserCommand]:
        if state.session.outreach is OutreachKind.PREFLIGHT and self._retries > 0:
            self._retries -= 1
            return state.t_ns + self._script.retry_after_ns, UserCommand.RETRY
        return state.t_ns + self._script.retry_after_ns, UserCommand.GIVE_UP
