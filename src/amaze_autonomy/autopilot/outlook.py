"""What is to be known of a flight, level-based: phase, waypoint of how many, distance and time that are left. Pure."""

from __future__ import annotations

from typing import NamedTuple, Optional, Tuple

from amaze_autonomy.engine.events import MissionPhase, MissionStatus
from amaze_autonomy.missions import FlightModel

from .flight_record import FlightRecord
from .loading import Loading, LoadRequest, Origin
from .mission_vehicle import VehicleWatch
from .remaining import Here, remaining

__all__ = ["IN_FLIGHT", "Outlook"]

_P = MissionPhase
IN_FLIGHT = (_P.TAKING_OFF, _P.FLYING, _P.HOLDING, _P.LANDING)
_SILENT = "the vehicle is silent"


class Outlook(NamedTuple):
    """All that it is read from.

    Args:
        watch: the vehicle.
        age_limit_ns: of what it says.
        model: how it flies.
        loading: of the file; None: nothing was loaded.
        origin: of the session.
        flight: what it has shown.
        phase: of the planner.
        message: of the planner.
    """

    watch: VehicleWatch
    age_limit_ns: int
    model: FlightModel
    loading: Optional[Loading]
    origin: Optional[Origin]
    flight: FlightRecord
    phase: MissionPhase
    message: str

    def status(self, t_ns: int, loaded: Optional[LoadRequest]) -> MissionStatus:
        """Return it for a file."""
        distance, seconds = self._left(t_ns)
        return MissionStatus(
            t_ns=t_ns,
            session_id=loaded.session_id if loaded else "",
            mission_id=loaded.mission_id if loaded else "",
            phase=self.phase,
            waypoint=self._waypoint(),
            waypoints=self.flight.waypoints,
            file_index=loaded.file_index if loaded else 0,
            repetition=loaded.repetition if loaded else 0,
            distance_left_m=distance,
            time_left_s=seconds,
            message=self.message if self.watch.known(t_ns, self.age_limit_ns) else _SILENT,
        )

    def _waypoint(self) -> int:
        """Return the waypoint it flies to, from 1; after the landing the last one that was reached."""
        if self.phase is _P.LANDED:
            return self.flight.reached
        return min(self.flight.reached + 1, self.flight.waypoints) if self.phase in IN_FLIGHT else 0

    def _left(self, t_ns: int) -> Tuple[Optional[float], Optional[float]]:
        loading, origin = self.loading, self.origin
        if loading is None or origin is None or not loading.accepted:
            return None, None
        waypoints = loading.trajectory.waypoints[self.flight.reached :]
        return remaining(self._here(t_ns, origin), () if self.phase is _P.LANDED else waypoints, self.model)

    def _here(self, t_ns: int, origin: Origin) -> Optional[Here]:
        watch, yaw = self.watch, self.watch.yaw_rad or 0.0
        if origin.local is not None:
            pose = watch.local(t_ns, self.age_limit_ns)
            if pose is None:
                return None
            x, y, z = (at - start for at, start in zip(pose.position_m, origin.local))
            return Here(x, y, z, yaw)
        place = watch.somewhere(t_ns, self.age_limit_ns)
        return None if place is None or origin.home is None else Here(*origin.home.to_local(place), watch.height_m, yaw)
