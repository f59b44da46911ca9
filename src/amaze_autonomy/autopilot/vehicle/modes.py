"""Flight modes, and who has control: numbers of the autopilots, names as PX4 and mavros write them, what each means.

ArduPilot's modes get the name of the PX4 mode that does the same, so that one engine reads both: GUIDED is OFFBOARD,
AUTO is AUTO.MISSION, BRAKE is AUTO.LOITER, and its LOITER, which is flown by the sticks, is POSCTL. ArduSub numbers its
modes otherwise: 9 is SURFACE there, not LAND.
"""

from __future__ import annotations

import re
from typing import FrozenSet, Mapping, NamedTuple, Optional, Tuple

from ..link.dialect import Message, mavlink

# --- modes ------------------------------------------------------------------------------------------------------------


LAND, HOLD = "AUTO.LAND", "AUTO.LOITER"
LANDING_MODES: FrozenSet[str] = frozenset({LAND, "AUTO.PRECLAND"})

_MAIN: Mapping[int, str] = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
    10: "TERMINATION",
}
_AUTO_MAIN = 4
_AUTO: Mapping[int, str] = {
    1: "AUTO.READY",
    2: "AUTO.TAKEOFF",
    3: "AUTO.LOITER",
    4: "AUTO.MISSION",
    5: "AUTO.RTL",
    6: "AUTO.LAND",
    7: "AUTO.RTGS",
    8: "AUTO.FOLLOW_TARGET",
    9: "AUTO.PRECLAND",
    10: "AUTO.VTOL_TAKEOFF",
}
_UNKNOWN = "MODE."
_ARDUPILOT: Tuple[Tuple[int, str, str], ...] = (
    (0, "STABILIZE", "STABILIZED"),
    (1, "ACRO", "ACRO"),
    (2, "ALT_HOLD", "ALTCTL"),
    (3, "AUTO", "AUTO.MISSION"),
    (4, "GUIDED", "OFFBOARD"),
    (5, "LOITER", "POSCTL"),
    (6, "RTL", "AUTO.RTL"),
    (7, "CIRCLE", "ORBIT"),
    (9, "LAND", "AUTO.LAND"),
    (11, "DRIFT", "DRIFT"),
    (13, "SPORT", "SPORT"),
    (14, "FLIP", "FLIP"),
    (15, "AUTOTUNE", "ALTCTL"),
    (16, "POSHOLD", "POSCTL"),
    (17, "BRAKE", "AUTO.LOITER"),
    (18, "THROW", "THROW"),
    (19, "AVOID_ADSB", f"{_UNKNOWN}19"),
    (20, "GUIDED_NOGPS", "OFFBOARD"),
    (21, "SMART_RTL", "AUTO.RTL"),
    (21, "CMODE(21)", "AUTO.RTL"),
    (22, "CMODE(22)", "POSCTL"),  # FLOWHOLD
    (23, "CMODE(23)", "AUTO.FOLLOW_TARGET"),
    (24, "CMODE(24)", "POSCTL"),  # ZIGZAG
    (27, "CMODE(27)", "AUTO.RTL"),  # AUTO_RTL
)
"""ArduCopter's modes: number, mavros' name, ours. mavros 1.x has no name for a mode above 20, and says its number."""
_ARDUPILOT_NAMES: Mapping[int, str] = {number: name for number, _, name in _ARDUPILOT}
_ARDUSUB: Mapping[int, str] = {
    0: "STABILIZED",
    1: "ACRO",
    2: "ALTCTL",  # ALT_HOLD
    3: "AUTO.MISSION",
    4: "OFFBOARD",  # GUIDED
    7: "ORBIT",  # CIRCLE
    9: f"{_UNKNOWN}SURFACE",
    16: "POSCTL",  # POSHOLD
    19: "MANUAL",
    20: f"{_UNKNOWN}MOTOR_DETECT",
    21: "ALTCTL",  # SURFTRAK
}
ARDUPILOT_NAMES: Mapping[str, str] = {
    **{said: name for _, said, name in _ARDUPILOT},
    "SURFACE": f"{_UNKNOWN}SURFACE",
}
"""Our names of ArduPilot's modes by those that mavros has for them; SURFACE is ArduSub's."""

_COMMANDED: FrozenSet[str] = frozenset({LAND, "AUTO.MISSION", "OFFBOARD", "AUTO.LOITER"})
_ARDUPILOT_NUMBERS: Mapping[str, int] = {
    name: number for number, _, name in reversed(_ARDUPILOT) if name in _COMMANDED
}  # of GUIDED and GUIDED_NOGPS the first

MANUAL_MODES: FrozenSet[str] = frozenset(
    {"MANUAL", "ALTCTL", "POSCTL", "ACRO", "STABILIZED", "RATTITUDE", "ORBIT", "DRIFT", "SPORT", "FLIP", "THROW"}
)
NEVER_OURS: FrozenSet[str] = frozenset(
    ["AUTO.RTL", "AUTO.RTGS", "AUTO.FOLLOW_TARGET", "AUTO.VTOL_TAKEOFF", "AUTO.READY", "TERMINATION"]
)


MULTICOPTERS: FrozenSet[int] = frozenset(
    {
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_TYPE_COAXIAL,
        mavlink.MAV_TYPE_HELICOPTER,
        mavlink.MAV_TYPE_HEXAROTOR,
        mavlink.MAV_TYPE_OCTOROTOR,
        mavlink.MAV_TYPE_TRICOPTER,
        mavlink.MAV_TYPE_DODECAROTOR,
        35,  # decarotor; older releases of pymavlink have neither name
        43,  # generic multirotor
    }
)
"""What is flown. Planes, rovers and submarines number their modes otherwise, and a VTOL may glide."""


def kind_problem(vehicle: int) -> str:
    """Return why a MAV_TYPE is not flown, in words; empty: it is a multicopter."""
    if vehicle in MULTICOPTERS:
        return ""
    if vehicle == mavlink.MAV_TYPE_GENERIC:
        return "the vehicle does not say what it is: set MAV_TYPE (PX4) or FRAME_CLASS (ArduPilot)"
    known = mavlink.enums["MAV_TYPE"].get(vehicle)
    return f"the vehicle says that it is no multicopter ({known.name if known else f'MAV_TYPE {vehicle}'})"


def is_piloted(mode: str) -> bool:
    """Return whether a mode is one that pilots choose; one that nobody knows (`MODE.n`) was not chosen by us either."""
    return mode in MANUAL_MODES or mode.startswith(_UNKNOWN)


def is_foreign(mode: str) -> bool:
    """Return whether a mode is one that we never command."""
    return is_piloted(mode) or mode in NEVER_OURS


def mode_name(autopilot: int, custom_mode: int, vehicle: int = mavlink.MAV_TYPE_QUADROTOR) -> str:
    """Return the name of a heartbeat's mode; one that nobody knows is named by its number, never left empty."""
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        names = _ARDUSUB if vehicle == mavlink.MAV_TYPE_SUBMARINE else _ARDUPILOT_NAMES
        return names.get(custom_mode, f"{_UNKNOWN}{custom_mode}")
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    name = _AUTO.get(sub) if main == _AUTO_MAIN else _MAIN.get(main)
    if name == "POSCTL" and sub == 1:
        return "ORBIT"
    return name or f"{_UNKNOWN}{main}.{sub}"


def px4_number(name: str) -> Optional[Tuple[int, int]]:
    """Return main and sub mode, parameters 2 and 3 of MAV_CMD_DO_SET_MODE; None: no such mode."""
    for sub, known in _AUTO.items():
        if known == name:
            return _AUTO_MAIN, sub
    return next(((main, 0) for main, known in _MAIN.items() if known == name), None)


def mode_number(autopilot: int, name: str) -> Optional[Tuple[int, int]]:
    """Return parameters 2 and 3 of MAV_CMD_DO_SET_MODE for a mode; None: this autopilot has no such."""
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        number = _ARDUPILOT_NUMBERS.get(name)
        return None if number is None else (number, 0)
    return px4_number(name)


# --- mavros' names ----------------------------------------------------------------------------------------------------
# mavros says the number alone, CMODE(n), of a mode that it has no name for, and of any mode in its first state, which
# it makes before it knows the autopilot.


_BOTH = (int(mavlink.MAV_AUTOPILOT_PX4), int(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA))
_NUMBER = re.compile(r"CMODE\((\d+)\)", re.ASCII)


def mavros_name(autopilot: int, custom_mode: int) -> str:
    """Return what mavros calls the mode of a heartbeat; PX4's modes have our names there."""
    if autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return mode_name(autopilot, custom_mode)
    said = (name for number, name, _ in _ARDUPILOT if number == custom_mode)
    return next(said, f"CMODE({custom_mode})")


def mavros_number(autopilot: int, name: str) -> Optional[int]:
    """Return the mode of a heartbeat that mavros calls so; None: this autopilot has no such, or is not known."""
    alone = _NUMBER.fullmatch(name)
    if alone is not None:
        return int(alone[1]) if autopilot in _BOTH else None
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return next((number for number, said, _ in _ARDUPILOT if said == name), None)
    known = px4_number(name)
    return None if known is None else known[1] << 24 | known[0] << 16


def autopilot_of(name: str) -> Optional[int]:
    """Return whose mode mavros calls so; None: both have it (ACRO), nobody has, or it is a number."""
    found = [autopilot for autopilot in _BOTH if mavros_number(autopilot, name) is not None]
    return found[0] if len(found) == 1 else None


# --- who has control --------------------------------------------------------------------------------------------------
# PX4 has the system status CRITICAL while it acts by itself, whatever the mode (a lost OFFBOARD stream leads to POSCTL
# without any pilot). ArduPilot has it as soon as a failsafe is triggered, also when nothing is done about it
# (BATT_FS_LOW_ACT 0): there a failsafe acts when the mode has meanwhile become one that failsafes choose, and not by
# our command. Without a failsafe, a mode that is flown by the sticks, and one that nobody of us ever commands or knows,
# is the pilot's; so is any mode after ours was confirmed, by two messages in a row, and left again. Disarmed, the mode
# shows what the user intended last and says nothing about control.
#
# The flag alone takes the vehicle from nobody: at a low battery of which nothing is made it stays in our mode, CRITICAL
# as an ArduPilot, and as a PX4 of a version to which a warning is a failsafe, too. A failsafe acts alone when the mode
# has left ours. A hold is ours or its own (PX4 holds before it returns): ours where the vehicle held, or flew on with
# the flag up, before that. Who commands the holds, the planner, takes no other one under the flag for its own.
#
# The mode is in each HEARTBEAT (PX4: 1 Hz, whatever it is asked) and in CURRENT_MODE, which shows a change within 0.12
# s.


_FAILSAFE: FrozenSet[int] = frozenset(
    {mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY, mavlink.MAV_STATE_FLIGHT_TERMINATION}
)
_CHOSEN_BY_FAILSAFES: FrozenSet[str] = frozenset({"AUTO.LAND", "AUTO.RTL", "AUTO.LOITER", "ALTCTL"})  # of ArduPilot
_NO_FAILSAFE_S: FrozenSet[str] = frozenset({"AUTO.MISSION", "AUTO.TAKEOFF", "OFFBOARD"})  # none chooses these
_IN_A_ROW = 2  # one wrong message confirms nothing
_SAME: Mapping[str, Tuple[str, ...]] = {"AUTO.LAND": ("AUTO.PRECLAND",)}


class Heartbeat(NamedTuple):
    """What a heartbeat says; its mode, when CURRENT_MODE told another one later."""

    t_ns: int
    armed: bool
    mode: str
    status: int
    autopilot: int
    vehicle: int = mavlink.MAV_TYPE_QUADROTOR

    @classmethod
    def of(cls, t_ns: int, message: Message) -> Heartbeat:
        """Return what a HEARTBEAT says."""
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        mode = mode_name(message.autopilot, message.custom_mode, message.type)
        return cls(t_ns, armed, mode, int(message.system_status), int(message.autopilot), int(message.type))


class Control:
    """Follows the heartbeats and what we command."""

    def __init__(self) -> None:
        self.beat: Optional[Heartbeat] = None
        self.mode_ns = 0
        self._commanded: Optional[str] = None
        self._shown = 0  # messages in a row that show what was commanded
        self._confirmed = False
        self._before: Optional[str] = None
        self._hold_is_ours = False  # one that shows under the flag
        self._flag_in_hold = False  # it came up while the vehicle held, and it holds since
        self._hold_commanded = False  # here, the one that it is in
        self._by_mode_alone = False  # its mode is new, and no heartbeat has come since
        self._flown = False  # armed since it was commanded: a mode to arm in is commanded before

    def add(self, beat: Heartbeat) -> None:
        """Take a heartbeat; of two in a row that say so it is disarmed again, and what was commanded is over."""
        over = not beat.armed and (self.beat is None or not self.beat.armed)
        flagged = self.beat is not None and self.beat.status in _FAILSAFE
        self.beat, self.mode_ns, self._by_mode_alone = beat, beat.t_ns, False
        if over and self._flown:
            self._commanded, self._confirmed = None, False
        self._flown = self._flown or beat.armed
        self._confirm(beat)
        if beat.status not in _FAILSAFE:
            self._before, self._hold_is_ours = beat.mode, beat.mode == HOLD
        elif beat.mode in _NO_FAILSAFE_S:
            self._hold_is_ours = True
        elif is_foreign(beat.mode):
            self._hold_is_ours = False
        rose = beat.status in _FAILSAFE and not flagged
        self._flag_in_hold = beat.status in _FAILSAFE and beat.mode == HOLD and (rose or self._flag_in_hold)

    def add_mode(self, t_ns: int, custom_mode: int) -> bool:
        """Take the mode of a CURRENT_MODE, after the first heartbeat; return whether it is another one."""
        beat = self.beat
        if beat is None:
            return False
        mode, self.mode_ns = mode_name(beat.autopilot, custom_mode, beat.vehicle), t_ns
        self.beat = beat._replace(mode=mode)
        self._by_mode_alone = self._by_mode_alone or mode != beat.mode
        self._confirm(self.beat)
        return mode != beat.mode

    def _confirm(self, beat: Heartbeat) -> None:
        self._shown = self._shown + 1 if beat.armed and self._is_commanded(beat.mode) else 0
        self._confirmed = self._confirmed or self._shown >= _IN_A_ROW
        self._hold_commanded = beat.mode == HOLD and (self._hold_commanded or self._is_commanded(HOLD))

    def _is_commanded(self, mode: str) -> bool:
        return self._commanded is not None and mode in (self._commanded, *_SAME.get(self._commanded, ()))

    def command(self, mode: str) -> None:
        """Note that we commanded a mode; the same again changes nothing."""
        if mode != self._commanded:
            self._commanded, self._confirmed, self._shown = mode, False, 0
            self._flown = self.beat is not None and self.beat.armed

    @property
    def failsafe(self) -> bool:
        """Whether the autopilot acts by a failsafe of its own."""
        beat = self.beat
        if beat is None or not beat.armed or beat.status not in _FAILSAFE:
            return False
        if beat.autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA or beat.status != mavlink.MAV_STATE_CRITICAL:
            return True
        return beat.mode in _CHOSEN_BY_FAILSAFES and beat.mode not in (self._before, self._commanded)

    @property
    def acts_alone(self) -> bool:
        """Whether a failsafe has taken the vehicle out of our modes; it may have chosen a pilot's, and he may fly it.

        A failsafe that lands it does what we would.
        """
        beat = self.beat
        if beat is None or not self.failsafe:
            return False
        if beat.mode == HOLD:
            return not self._hold_is_ours and not self._is_commanded(HOLD)
        return is_foreign(beat.mode)

    @property
    def acts_unasked(self) -> bool:
        """Whether a failsafe acts alone, or it holds under the flag and whoever asks has commanded no hold."""
        holds = self.beat is not None and self.beat.mode == HOLD and self.failsafe
        return self.acts_alone or (holds and not self._hold_commanded)

    @property
    def may_wait(self) -> bool:
        """Whether a failsafe acts unasked, or may have taken our hold for its own: PX4 holds before it returns.

        Any mode that is commanded then, a hold as well, is the user's takeover to it, and ends the failsafe.
        """
        waits = self.beat is not None and self.beat.mode == HOLD and self._flag_in_hold and self.failsafe
        return self.acts_unasked or waits

    @property
    def unexplained(self) -> bool:
        """Whether it is in a mode that was not commanded, and no heartbeat has said yet whether a failsafe chose it."""
        beat = self.beat
        return beat is not None and beat.armed and self._by_mode_alone and not self._is_commanded(beat.mode)

    @property
    def pilot(self) -> bool:
        """Whether the pilot flies, or has changed the mode."""
        beat = self.beat
        if beat is None or not beat.armed or self.failsafe:
            return False
        if is_foreign(beat.mode):
            return True
        return self._confirmed and not self._is_commanded(beat.mode)

    @property
    def killed(self) -> bool:
        """Whether the kill switch is on: PX4 shows FLIGHT_TERMINATION then."""
        return self.beat is not None and self.beat.status == mavlink.MAV_STATE_FLIGHT_TERMINATION
