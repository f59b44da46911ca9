"""The rows that the autopilot adds to the pre-flight table; each is a function of what is known, listed in one table.

What cannot be judged is UNKNOWN, which refuses the takeoff. A need that the configuration switches off is a warning.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Callable, Optional, Sequence, Tuple

from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.events import Landed, VehicleLanded
from amaze_autonomy.monitoring.land_switch import LandSwitchMonitor

from ...engine.events import Check, Verdict
from ..link.dialect import mavlink
from ..link.peers import HEAR_ONE_ALONE
from .asked import ParameterState
from .battery import CHARGING, LOW, OK, STATE_NAMES
from .modes import kind_problem
from .vehicle import VehicleState

_S = 1_000_000_000
_COMPLAINTS_NS = 60 * _S
_LONGEST_ADVICE = 300
_MOST_CHANNELS, _NO_PULSE = 18, (0, 65535)
_NO_FLAGS = (
    "mavros hands on no EKF_STATUS_REPORT of this ArduPilot, so its position is unknown: look whether mavlink/from "
    "beside mavros' namespace has it (docs/autopilot.md)"
)
_NOBODYS = "mavros names a mode that neither PX4 nor ArduPilot has, so nobody knows how to land it: choose another mode"
_NOT_JUDGED = "the autopilot does not judge its battery: its level and voltage alone count"
_SILENT = (
    "look at its power module; one that was unplugged on the ground is forgotten by itself after half a minute, "
    "one that fell silent in flight when the autopilot was switched off"
)
_NO_BEAT = "the vehicle is heard, but its last heartbeat is too old to say it: look at the rate and losses of its link"
_NOTHING = "none of {} is named in autopilot.yaml: nothing was compared"
_OTHER_NAMES = "this ArduPilot knows none of ardupilot_parameters in autopilot.yaml (docs/autopilot.md)"


@dataclass(frozen=True)
class Preflight:
    """What the rows look at.

    Args:
        t_ns: now.
        vehicle: its state.
        settings: limits and needs.
        parameters: that are compared.
        ground: what the landing detection says; None: it is silent.
        strangers: where others speak from that say our vehicle's system id; None: that cannot be told.
    """

    t_ns: int
    vehicle: VehicleState
    settings: AutopilotSettings
    parameters: Sequence[ParameterState] = ()
    ground: Optional[Landed] = None
    strangers: Optional[Sequence[str]] = ()

    @property
    def age_s(self) -> Optional[float]:
        """Time since anything was heard."""
        age_ns = self.vehicle.link_age_ns(self.t_ns)
        return None if age_ns is None else age_ns / _S

    @property
    def beat_age_s(self) -> Optional[float]:
        """Age of the heartbeat."""
        beat = self.vehicle.beat
        return None if beat is None else (self.t_ns - beat.t_ns) / _S

    @property
    def connected(self) -> bool:
        """Whether there is a link."""
        return self.vehicle.connected(self.t_ns)


def preflight_rows(known: Preflight) -> Tuple[Check, ...]:
    """Return every row."""
    return tuple(row(known) for row in _ROWS)


def _is_ardupilot(known: Preflight) -> bool:
    beat = known.vehicle.beat
    return beat is not None and beat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA


def _link(known: Preflight) -> Check:
    limit = known.settings.limits.link_age_limit_ns / _S
    heard = "" if known.connected else "the autopilot is not heard: check cable, port and baud rate"
    comes, beat = heard or (_NOBODYS if _is_nobodys(known) else ""), known.vehicle.beat
    advice = comes or ("" if beat is None else kind_problem(beat.vehicle))
    verdict = Verdict.FAIL if advice else Verdict.PASS
    return Check("autopilot link", verdict, known.age_s, limit, "s", known.age_s, advice, heals=bool(comes))


def _is_nobodys(known: Preflight) -> bool:
    """Return whether mavros has not yet named a mode that tells the autopilot behind it."""
    beat, through_mavros = known.vehicle.beat, known.settings.backend == "mavros"
    return through_mavros and beat is not None and beat.autopilot == mavlink.MAV_AUTOPILOT_GENERIC


_UNTOLD = f"nobody can tell: mavros' mavlink/from says nothing of this vehicle; {HEAR_ONE_ALONE}"


def _one_vehicle(known: Preflight) -> Check:
    """Say who else speaks as our vehicle, or is mixed in; after a burst of lost messages ours may look like two."""
    if known.strangers is None:
        return _row(known, "one vehicle", _UNTOLD, good=None, needed=False)
    where = ", ".join(known.strangers)
    advice = f"another one with its system id speaks from {where}: switch it off, or give it another MAV_SYS_ID or port"
    if known.settings.backend == "mavros":
        advice = f"mavros mixes another vehicle into ours ({where}): {HEAR_ONE_ALONE}"
    return _row(known, "one vehicle", advice, good=not known.strangers, heals=True)


def _row(
    known: Preflight, name: str, advice: str, *, good: Optional[bool], needed: bool = True, heals: bool = False
) -> Check:
    """Return a row of a yes or no; without a link it is unknown, and what is not heard yet may come by itself."""
    if not known.connected:
        return Check(name, Verdict.UNKNOWN, age_s=known.age_s, advice="check the link to the autopilot", heals=True)
    bad = (Verdict.UNKNOWN if good is None else Verdict.FAIL) if needed else Verdict.WARN
    verdict = Verdict.PASS if good else bad
    comes = not good and (good is None or heals)
    return Check(name, verdict, age_s=known.age_s, advice="" if good else advice[:_LONGEST_ADVICE], heals=comes)


def _row_of_beat(known: Preflight, name: str, advice: str, *, good: bool) -> Check:
    """Return a row of what the heartbeat alone says: of an old one it is unknown, though the vehicle is heard."""
    said = known.vehicle.armed(known.t_ns) is not None
    row = _row(known, name, advice if said else _NO_BEAT, good=good if said else None)
    return replace(row, age_s=known.beat_age_s)


def _not_armed(known: Preflight) -> Check:
    good = known.vehicle.armed(known.t_ns) is False
    return _row_of_beat(known, "not armed", "disarm the vehicle", good=good)


def _prearm(known: Preflight) -> Check:
    """Ask the verdict; ArduPilot gives that of the present mode, and refuses in GUIDED when it has no position."""
    vehicle = known.vehicle
    good = vehicle.system.prearm(known.t_ns)
    if good and _is_ardupilot(known):
        good = vehicle.position.valid(known.t_ns)
    texts = vehicle.texts.complaints(known.t_ns, _COMPLAINTS_NS)
    waits = not vehicle.position.valid(known.t_ns) or vehicle.position.home_ns is None  # of its estimator and GPS
    return _row(known, "pre-arm check", _said(texts, known), good=good, heals=waits)


def _said(texts: Sequence[str], known: Preflight) -> str:
    if texts:
        return "the autopilot says: " + "; ".join(texts)
    if known.settings.backend == "mavros" and _is_ardupilot(known) and not known.vehicle.position.judged:
        return _NO_FLAGS
    if not known.vehicle.position.valid(known.t_ns):
        return "the autopilot has no valid position: wait for its estimator"
    return "the autopilot names no reason (on a link without a ground station it withholds them): see there"


def _landed(known: Preflight) -> Check:
    name, landed = "landed state", known.vehicle.landed(known.t_ns)
    if landed is VehicleLanded.UNKNOWN:
        return _row(known, name, "the autopilot does not say whether it is on the ground", good=None)
    if landed is not VehicleLanded.ON_GROUND:
        return _row(known, name, f"the autopilot says {landed.name}: put it on the ground", good=False)
    if known.ground is Landed.AIRBORNE:
        advice = "the autopilot says ON_GROUND, the range finder that it is in the air: check its mounting height"
        return _row(known, name, advice, good=False)
    unsure = known.ground is not Landed.ON_GROUND
    return _row(known, name, "the range finder cannot confirm it", good=not unsure, needed=not unsure)


def _rc(known: Preflight) -> Check:
    heard = known.vehicle.system.rc(known.t_ns)
    return _row(
        known, "RC receiver", "switch on the transmitter", good=heard, needed=known.settings.needs.rc, heals=True
    )


def _kill(known: Preflight) -> Check:
    good = not known.vehicle.control.killed
    return _row_of_beat(known, "kill switch", "release the kill switch", good=good)


def _home(known: Preflight) -> Check:
    known_home = known.vehicle.position.home_ns is not None
    needed, advice = known.settings.needs.home, "wait for the home position"
    return _row(known, "home position", advice, good=known_home, needed=needed, heals=True)


def _parameters(known: Preflight) -> Check:
    states = known.parameters
    wrong = [one.difference for one in states if one.agrees is False]
    unread = [one.name for one in states if one.agrees is None]
    words = wrong + ([f"not read: {', '.join(unread)}"] if unread else [])
    if not states:
        words = [_NOTHING.format("an ArduPilot" if _is_ardupilot(known) else "a PX4")]
    elif len(unread) == len(states) and _is_ardupilot(known):
        words = [_OTHER_NAMES]
    return _row(known, "parameters", "; ".join(words), good=not words, needed=False)


def _clocks(known: Preflight) -> Check:
    name, limit_ns = "time of day", known.settings.needs.clock_difference_limit_ns
    offset_ns = known.vehicle.offset.utc_offset_ns
    if offset_ns is None:
        return _row(known, name, "the autopilot knows no time of day (no GPS)", good=False, needed=False)
    advice = (
        "the autopilot's clock (GPS time; a simulator's may lag) and this computer's differ: set the one that is wrong"
    )
    row = _row(known, name, advice, good=abs(offset_ns) <= limit_ns, needed=False)
    limit_s = limit_ns / _S
    return Check(name, row.verdict, offset_ns / _S, limit_s, "s", row.age_s, row.advice, other_limit=-limit_s)


_ROWS: Tuple[Callable[[Preflight], Check], ...] = (
    _link,
    _one_vehicle,
    _not_armed,
    _prearm,
    _landed,
    _rc,
    _kill,
    _home,
    _parameters,
    _clocks,
)


def land_switch_rows(known: Preflight, switch: LandSwitchMonitor) -> Tuple[Check, ...]:
    """Return the row of the switch that means land, where the configuration names one."""
    channel = switch.spec.channel
    if not channel:
        return ()
    on = switch.on(known.t_ns)
    advice = "switch it back: it says land" if on else f"channel {channel} is not heard"
    return (_row(known, "land switch", advice, good=None if on is None else not on, heals=True),)


def battery_state_row(known: Preflight) -> Check:
    """Return the row of the charge state: the autopilot's own judgement, which knows the voltage.

    One that it does not give is a warning: not every PX4 gives it, and mavros has no topic with it.
    """
    battery = known.vehicle.battery
    silent, reading = battery.silent(known.t_ns), battery.reading()
    if silent and known.connected:
        numbers = ", ".join(map(str, silent))
        return _row(known, "battery state", f"nothing is heard of battery {numbers}: {_SILENT}", good=False)
    state = 0 if reading is None else reading.charge_state
    if state in (OK, CHARGING):
        return _row(known, "battery state", "", good=True)
    if not LOW <= state < CHARGING:
        return _row(known, "battery state", _NOT_JUDGED, good=False, needed=False)
    advice = f"the autopilot says {STATE_NAMES[state]}: change or charge the battery"
    return _row(known, "battery state", advice, good=False)


def channel_width_us(message: Any, number: int) -> Optional[float]:
    """Return the pulse width of a channel, from 1, of RC_CHANNELS; None: the transmitter has not that channel."""
    if not 0 < number <= min(message.chancount, _MOST_CHANNELS):
        return None
    width_us = getattr(message, f"chan{number}_raw")
    return None if width_us in _NO_PULSE else float(width_us)
