"""The simulated mission planner and sequencer: waypoint files to the vehicle, takeoff, hold, resume, land."""

from __future__ import annotations

from typing import List, Optional, Tuple

from amaze_autonomy.engine.commands import LoadMission, MissionAction, MissionCommand, Request
from amaze_autonomy.engine.events import Event, MissionPhase, MissionStatus, VehicleLanded
from amaze_autonomy.missions import Waypoint, distance_m, leg_s

from ..scenario import Subject
from ..vehicle.vehicle import LANDING_MODES, Mode, Vehicle
from .peer import Cadence, Peer, Site, accepted, refused, slowness

__all__ = ["Planner"]

_IN_FLIGHT = (MissionPhase.TAKING_OFF, MissionPhase.FLYING, MissionPhase.HOLDING, MissionPhase.LANDING)


class Planner(Peer):
    """Reads its phase from the vehicle: what was commanded is done when the vehicle shows it."""

    name = "mission_planner"

    def __init__(self, site: Site) -> None:
        super().__init__(site)
        self._phase = MissionPhase.IDLE
        self._session = self._mission = self._message = ""
        self._file = self._repetition = 0
        self._was_armed = False
        self._cadence = Cadence(site.settings.rates.planner_status_rate_hz)

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Load a waypoint file, or carry out a command."""
        if isinstance(command, LoadMission):
            problem = self._load(command)
        elif isinstance(command, MissionCommand):
            problem = self._command(command)
        else:
            return super().answer(t_ns, command)
        return refused(command, problem) if problem else accepted(command)

    def step(self, t_ns: int) -> List[Event]:
        """Follow the vehicle, land at the end of the sequence, and tell."""
        self._go_on(self.site.vehicle)
        self._follow(self.site.vehicle)
        vehicle = self.site.vehicle
        key = (self._phase, self._session, self._file, self._repetition, vehicle.reached, self._message)
        return [self._status(t_ns)] if self._cadence.due(t_ns, key, slowness(self.site, self.name)) else []

    def _load(self, command: LoadMission) -> str:
        vehicle = self.site.vehicle
        files = self.site.settings.trajectories.get(command.mission_id)
        if files is None:
            return f"there is no mission {command.mission_id!r}"
        if not 0 <= command.file_index < len(files):
            return f"mission {command.mission_id} has {len(files)} waypoint files, there is no {command.file_index + 1}"
        x, y, _ = vehicle.position_m
        problem = vehicle.upload(files[command.file_index].from_start(vehicle.yaw_rad, x, y).waypoints)
        if problem:
            return problem
        self._session, self._mission = command.session_id, command.mission_id
        self._file, self._repetition = command.file_index, command.repetition
        self._phase, self._message, self._was_armed = MissionPhase.LOADED, "", False
        self.site.note("loaded")
        return ""

    def _command(self, command: MissionCommand) -> str:
        if command.action == MissionAction.LAND:
            return self._land()
        if command.action == MissionAction.ABORT:
            return self._abort()
        if command.session_id != self._session or not self._session:
            return f"session {command.session_id!r} is not the one that is loaded"
        if command.action == MissionAction.TAKEOFF:
            return self._take_off()
        return self._hold() if command.action == MissionAction.HOLD else self._resume()

    def _take_off(self) -> str:
        if self._phase != MissionPhase.LOADED:
            return f"there is nothing to fly in phase {self._phase.name}"
        problem = self.site.vehicle.take_off()
        if not problem:
            self._phase = MissionPhase.TAKING_OFF
        return problem

    def _hold(self) -> str:
        if self._phase not in (MissionPhase.TAKING_OFF, MissionPhase.FLYING, MissionPhase.HOLDING):
            return f"there is nothing to hold in phase {self._phase.name}"
        return self.site.vehicle.hold()

    def _resume(self) -> str:
        if self._phase not in (MissionPhase.TAKING_OFF, MissionPhase.FLYING, MissionPhase.HOLDING):
            return f"there is nothing to resume in phase {self._phase.name}"
        return self.site.vehicle.resume()

    def _land(self) -> str:
        problem = self.site.vehicle.land()
        if not problem and not self.site.vehicle.armed and self._phase in _IN_FLIGHT:
            self._phase = MissionPhase.LANDED  # the takeoff was cancelled before it armed
        return problem

    def _abort(self) -> str:
        vehicle = self.site.vehicle
        if vehicle.airborne:
            return vehicle.land()
        problem = vehicle.disarm()
        if not problem and self._phase in _IN_FLIGHT:
            self._phase = MissionPhase.LANDED
        return problem

    def _go_on(self, vehicle: Vehicle) -> None:
        """Go on by itself while a fault says so."""
        if self._phase is MissionPhase.HOLDING and self.site.faults.active(Subject.PROCESS, "goes_on", self.name):
            vehicle.resume()

    def _follow(self, vehicle: Vehicle) -> None:
        """Read the phase from the vehicle."""
        if self._phase not in _IN_FLIGHT:
            return
        self._was_armed = self._was_armed or vehicle.armed
        if vehicle.finished and vehicle.mode == Mode.MISSION and not vehicle.pilot:
            vehicle.land()
        if self._is_over(vehicle):
            self._phase = MissionPhase.LANDED
        elif not self._was_armed:
            return  # the mode is still that of the flight before
        elif vehicle.pilot:
            self._message = "the pilot has control"
        elif vehicle.mode in LANDING_MODES:
            self._phase = MissionPhase.LANDING
        elif vehicle.mode == Mode.LOITER and vehicle.armed:
            self._phase = MissionPhase.HOLDING
        elif vehicle.mode == Mode.MISSION and vehicle.airborne:
            self._phase = MissionPhase.FLYING
        elif vehicle.mode == Mode.TAKEOFF:
            self._phase = MissionPhase.TAKING_OFF

    def _is_over(self, vehicle: Vehicle) -> bool:
        return self._was_armed and not vehicle.armed and vehicle.landed == VehicleLanded.ON_GROUND

    def _waypoint(self, waypoints: int) -> int:
        """Return the waypoint it flies to, from 1; after the landing the last one that was reached."""
        if self._phase is MissionPhase.LANDED:
            return self.site.vehicle.reached
        return min(self.site.vehicle.reached + 1, waypoints) if self._phase in _IN_FLIGHT else 0

    def _status(self, t_ns: int) -> MissionStatus:
        vehicle = self.site.vehicle
        waypoints = len(vehicle.waypoints) if self._session else 0
        distance, seconds = _left(vehicle) if self._session else (None, None)
        failed = self.site.faults.active(Subject.PROCESS, "fails", self.name) is not None
        return MissionStatus(
            t_ns=t_ns,
            session_id=self._session,
            mission_id=self._mission,
            phase=MissionPhase.FAILED if failed else self._phase,
            waypoint=self._waypoint(waypoints),
            waypoints=waypoints,
            file_index=self._file,
            repetition=self._repetition,
            distance_left_m=distance,
            time_left_s=seconds,
            message="the mission cannot be flown any further" if failed else self._message,
        )


def _left(vehicle: Vehicle) -> Tuple[float, float]:
    """Return metres and seconds along the waypoints that are left."""
    here = Waypoint(*vehicle.position_m, vehicle.yaw_rad, 0.0)
    metres = seconds = 0.0
    for target in vehicle.waypoints[vehicle.reached :]:
        metres += distance_m(here, target)
        seconds += leg_s(here, target, vehicle.settings.model) + target.hold_s
        here = target
    return round(metres, 3), round(seconds, 3)
