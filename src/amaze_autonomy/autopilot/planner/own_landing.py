"""A landing that nobody has asked for: it is sent once a flight mode that is heard now says that the vehicle is ours.

Its mode may be what alone is not heard any more: then a pilot may have taken over, and that the vehicle leaves its way
is his doing. So the mode is asked for and waited for. When it has not come in time, what happens is left to who knows
more than we do. The stream of set-points ends: a PX4 that is in OFFBOARD still lands by its own failsafe, one that a
pilot flies does nothing; an ArduPilot stays where it is. And the planner is FAILED, so that the engine, which has the
autopilot node to look at the vehicle as well, lands: what it asks for is always sent. The landing is wanted still:
it is sent whenever the mode is heard, and is ours.
"""

from __future__ import annotations

from typing import List

from ..link.dialect import Message, mavlink
from .mission_upload import Dialect
from .mission_vehicle import MODE_LATE_NS, OFFBOARD, RESTART, VehicleWatch

_ASK_BEAT_NS, _ASK_RESTART_NS = 300_000_000, 500_000_000  # between two questions
ENDS = "the planner ends"


class OwnLanding:
    """What the planner wants of itself.

    Args:
        watch: the vehicle.
        limit_ns: for so long it waits for the flight mode.
    """

    def __init__(self, watch: VehicleWatch, limit_ns: int) -> None:
        self._watch, self._limit_ns = watch, limit_ns
        self.why = ""  # in words; empty: none is wanted
        self.left = False  # somebody else flies who was heard while it waited
        self._since_ns = 0
        self._given_up = False

    def want(self, t_ns: int, why: str) -> None:
        """Want a landing; where one is wanted already it waits on, unless the planner ends."""
        if not self.why or (why == ENDS and self.why != ENDS):
            self.why, self._since_ns, self._given_up, self.left = why, t_ns, False, False

    def drop(self) -> str:
        """Want none any more: it is landed, or there is nothing to land; return why one was wanted."""
        why, self.why = self.why, ""
        return why

    def is_due(self, t_ns: int) -> bool:
        """Return whether it may be commanded; it is dropped where the mode that was heard is somebody else's."""
        watch = self._watch
        if not self.why or watch.mode_ns is None or t_ns - watch.mode_ns > MODE_LATE_NS:
            return False
        self.left = bool(watch.armed and watch.others_fly) if self.why == ENDS else watch.off_setpoints
        if self.left:
            self.drop()
        return not self.left and (self.why == ENDS or (bool(watch.armed) and watch.mode == OFFBOARD))

    def gives_up(self, t_ns: int) -> bool:
        """Return True once, when the mode was waited for in vain; told to end, the node's own limit ends the wait."""
        in_vain = bool(self.why) and self.why != ENDS and t_ns - self._since_ns >= self._limit_ns
        once, self._given_up = in_vain and not self._given_up, self._given_up or in_vain
        return once

    def wants_beat(self, t_ns: int) -> bool:
        """Return whether a heartbeat is to be asked for: this waits for it, or it is late."""
        beat_ns = self._watch.heartbeat_ns
        return bool(self.why) or (beat_ns is not None and t_ns - beat_ns > MODE_LATE_NS)

    @property
    def not_sent(self) -> str:
        """Why none was commanded, in words."""
        mode = f"somebody else flies it (mode {self._watch.mode})" if self.left else "its flight mode is not known"
        return f"no landing was commanded: {mode}"

    @property
    def words(self) -> str:
        """What it waits for, and why; empty: for nothing."""
        return f"{self.why}: it lands once its flight mode is heard" if self.why else ""


class Questions:
    """What is asked of the vehicle until it says it, and not too often.

    Args:
        watch: the vehicle.
    """

    def __init__(self, watch: VehicleWatch) -> None:
        self._watch = watch
        self._beat_due_ns = self._restart_due_ns = 0

    def beat(self, t_ns: int, *, unsure: bool) -> List[Message]:
        """Ask for a heartbeat, where something is not known that it says."""
        if not unsure or t_ns < self._beat_due_ns:
            return []
        self._beat_due_ns = t_ns + _ASK_BEAT_NS
        which = (float(mavlink.MAVLINK_MSG_ID_HEARTBEAT), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        return [mavlink.MAVLink_command_long_message(*self._watch.target, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, *which)]

    def restart(self, t_ns: int, *, flies_a_mission: bool) -> List[Message]:
        """Ask an ArduPilot that is to fly a mission, until it says it, whether one that is held would begin anew."""
        watch = self._watch
        asks = flies_a_mission and watch.dialect is Dialect.ARDUPILOT and watch.armed is False
        if not asks or watch.restarts is not None or t_ns < self._restart_due_ns:
            return []
        self._restart_due_ns = t_ns + _ASK_RESTART_NS
        return [mavlink.MAVLink_param_request_read_message(*watch.target, RESTART.encode("ascii"), -1)]

    def forget(self, t_ns: int) -> None:
        """Ask at once whether a mission would begin anew: another file is loaded."""
        self._restart_due_ns = t_ns
