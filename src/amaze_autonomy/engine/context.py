"""One call of the engine: the state in the making, the event, the rules, and the commands collected so far.

A `Context` lives inside one call of `decide` and is never seen outside the engine. Guards read it, effects change it.
Before it the table of flight modes.
"""

from __future__ import annotations

from typing import Any, FrozenSet, List, Mapping, Optional, Tuple

from .commands import MESSAGES, Command, Level, MissionAction, Notify, Request, Value, Values
from .events import (
    AutopilotStatus,
    Event,
    Landed,
    Mission,
    MissionPhase,
    MissionSelected,
    Shutdown,
    UserCommand,
    UserRequest,
    VehicleLanded,
)
from .rules import Limits, Rules
from .state import Asked, EngineState, State, evolve

# --- modes ------------------------------------------------------------------------------------------------------------
# Which flight modes of the PX4 are the answer to which command of ours (rule 4 of DESIGN.md: never fight the pilot).
#
# A mode that matches the outstanding or the last confirmed command is ours. The planner lands by itself at the end of
# its sequence: the modes of landing are its own while it says so, and somebody else's landing while it does not.
# Names as PX4 and mavros write them.


LANDING_MODES: FrozenSet[str] = frozenset({"AUTO.LAND", "AUTO.PRECLAND"})
HOLDING_MODES: FrozenSet[str] = frozenset({"AUTO.LOITER"})

TAKES_OFF = (MissionAction.TAKEOFF, MissionAction.RESUME)
MISSION_MODE, SET_POINT_MODE = "AUTO.MISSION", "OFFBOARD"
FLYING_MODES: FrozenSet[str] = frozenset({"AUTO.TAKEOFF", MISSION_MODE, SET_POINT_MODE})

DIRECT_MODES: Mapping[MissionAction, FrozenSet[str]] = {
    MissionAction.TAKEOFF: FLYING_MODES,
    MissionAction.RESUME: FLYING_MODES,
    MissionAction.HOLD: HOLDING_MODES | {SET_POINT_MODE},
    MissionAction.LAND: LANDING_MODES,
    MissionAction.ABORT: LANDING_MODES,
}
"""What a command itself asks for: such a mode is ours even while the autopilot's failsafe flag is set."""

MODES: Mapping[MissionAction, FrozenSet[str]] = {
    **DIRECT_MODES,
    MissionAction.TAKEOFF: FLYING_MODES | HOLDING_MODES,  # PX4 loiters after its takeoff
}

_FLEW = (MissionPhase.FLYING, MissionPhase.HOLDING, MissionPhase.LANDING, MissionPhase.LANDED)
_ON_THE_WAY: Mapping[str, int] = {"AUTO.TAKEOFF": 1, "AUTO.LOITER": 1, SET_POINT_MODE: 2, MISSION_MODE: 3}
"""How far a takeoff has come by its mode; some are left out: ArduPilot takes off in OFFBOARD (its GUIDED)."""


_OF_A_MISSION: Mapping[MissionAction, FrozenSet[str]] = {
    MissionAction.TAKEOFF: frozenset({MISSION_MODE}),
    MissionAction.RESUME: frozenset({MISSION_MODE}),
    MissionAction.HOLD: HOLDING_MODES,
}
_OF_SET_POINTS: FrozenSet[str] = frozenset({SET_POINT_MODE})
Modes = Mapping[MissionAction, FrozenSet[str]]


def without_others(modes: Modes, flown_by: str) -> Modes:
    """Return the modes of each command without those of the other way to fly: they are somebody else's.

    Args:
        modes: `MODES` or `DIRECT_MODES`.
        flown_by: the mode that the flight is flown in: by a mission of the autopilot no set-points are ours any more,
            by set-points no mission and no hold of the autopilot; empty: not known, and all of them are.
    """
    if flown_by == SET_POINT_MODE:
        return {action: names - _OF_A_MISSION.get(action, frozenset()) for action, names in modes.items()}
    return {action: names - _OF_SET_POINTS for action, names in modes.items()} if flown_by else modes


_OWN: Mapping[str, Tuple[Modes, Modes]] = {
    way: (without_others(MODES, way), without_others(DIRECT_MODES, way)) for way in ("", MISSION_MODE, SET_POINT_MODE)
}


def says_nothing(status: AutopilotStatus) -> bool:
    """Return True when a status does not say whether the vehicle is armed, or whether it is on the ground."""
    return status.armed is None or status.landed is VehicleLanded.UNKNOWN


def fast(status: AutopilotStatus, limit_m_s: float) -> Values:
    """Return the speeds above a limit, over ground and up or down; an unknown one is not."""
    speeds = (("speed over ground", status.horizontal_speed_m_s), ("vertical speed", status.vertical_speed_m_s))
    return tuple(
        Value(name, speed, limit_m_s, "m/s") for name, speed in speeds if speed is not None and abs(speed) > limit_m_s
    )


def is_further(mode: str, flown: str) -> bool:
    """Return True when a takeoff has come further in one mode than in another; before all of them there is none."""
    return _ON_THE_WAY.get(mode, 0) > _ON_THE_WAY.get(flown, 0)


def ours(
    mode: str,
    commanded: Tuple[MissionAction, ...],
    confirmed: Optional[MissionAction],
    flown: str = "",
    *,
    lands: bool = False,
    modes: Modes = MODES,
) -> bool:
    """Return True when a flight mode matches an outstanding or the last confirmed command; an unknown mode does.

    Args:
        mode: the flight mode; empty: unknown.
        commanded: all commands since the last confirmed one: a late effect of the last but one is ours as well.
        confirmed: the last command that a mode answered.
        flown: how far a takeoff or a resume has come. What lies before it is no answer to that any more: a hold, or
            set-points, after the mission was flown are the pilot's, or another ground station's.
        lands: the planner says that it lands.
        modes: that are the answer to each command.
    """
    if not mode or (lands and mode in LANDING_MODES):
        return True
    actions = commanded if confirmed is None else (*commanded, confirmed)
    past = is_further(flown, mode)
    return any(mode in modes[action] and not (past and action in TAKES_OFF) for action in actions)


# --- context ----------------------------------------------------------------------------------------------------------


_NS = 1_000_000_000


class Context:
    """What guards and effects work on."""

    __slots__ = ("asked_by", "commands", "event", "limits", "now", "rules", "selected", "signal", "state", "user")

    def __init__(self, state: EngineState, event: Event, rules: Rules) -> None:
        self.state = state
        self.event = event
        self.rules = rules
        self.limits: Limits = rules.limits
        self.now: int = event.t_ns
        self.commands: List[Command] = []
        self.user: Optional[UserCommand] = event.command if isinstance(event, UserRequest) else None
        #: What asks in the place of a person at a console; empty: nothing does.
        self.asked_by: str = event.by if isinstance(event, UserRequest) else ""
        self.selected: Tuple[Mission, ...] = event.missions if isinstance(event, MissionSelected) else ()
        self.signal: str = event.signal if isinstance(event, Shutdown) else state.signal

    def set(self, **changes: Any) -> None:
        """Change fields of the state; a part begins anew by one assignment."""
        self.state = evolve(self.state, **changes)

    def put(self, part: str, **changes: Any) -> None:
        """Change fields of a part of the state."""
        self.set(**{part: evolve(getattr(self.state, part), **changes)})

    @property
    def modes(self) -> Modes:
        """The flight modes that are the answer to each command in this flight."""
        return _OWN[self._flown_by()][0]

    @property
    def direct_modes(self) -> Modes:
        """Those of them that a command itself asks for."""
        return _OWN[self._flown_by()][1]

    def _flown_by(self) -> str:
        """Return the mode that it is flown in; set-points may be a takeoff's, where the mission does not say them."""
        mission, mode = self.state.session.mission, self.state.flight.flown_by
        known = mode == MISSION_MODE or (mission is not None and mission.set_points)
        return mode if known else ""

    def asked(self) -> bool:
        """Return True while somebody asks for something that was not carried out yet."""
        return self.user is not None or bool(self.selected) or bool(self.signal)

    def consume(self) -> None:
        """Forget what the event asks for: a request is carried out once."""
        self.user, self.selected, self.signal = None, (), ""

    def take_id(self) -> int:
        """Return a new id for a request."""
        identity = self.state.next_id
        self.set(next_id=identity + 1)
        return identity

    def send(self, request: Request) -> Asked:
        """Send a request to a peer; return what is remembered of it."""
        self.commands.append(request)
        return Asked(id=request.id, sent_ns=self.now)

    def drop_queue(self) -> None:
        """Drop the missions that were still to come, and say so."""
        if self.state.queue:
            self.notify("queue_dropped", missions=", ".join(mission.id for mission in self.state.queue))
            self.set(queue=())

    def notify(self, key: str, **values: object) -> None:
        """Tell the user by an entry of the table of messages; ignore the empty key."""
        if not key:
            return
        entry = MESSAGES[key]
        text, advice = (words.format(**values).rstrip() for words in (entry.text, entry.advice))
        told = Notify(level=entry.level, key=key, text=text, advice=advice)
        self.set(said=told)
        if told.level is Level.ALARM and self.state.state is State.LAND:
            self.put("landing", alarms=(*(each for each in self.state.landing.alarms if each.key != key), told))
        self.commands.append(told)

    # --- the vehicle, as far as it is known freshly -------------------------------------------------------------------

    def vehicle(self) -> Optional[AutopilotStatus]:
        """Return the autopilot's status if it is fresh: the stream and the link behind it; else None."""
        status, heard_ns = self.state.peers.autopilot, self.state.peers.autopilot_ns
        if status is None or heard_ns is None or status.link_age_s is None:
            return None
        age_ns = self.now - heard_ns
        link_ns = age_ns + int(status.link_age_s * _NS)
        fresh = age_ns <= self.limits.autopilot_status_limit_ns and link_ns <= self.limits.autopilot_link_limit_ns
        return status if fresh else None

    def unknown_for_long(self) -> bool:
        """Return True when the autopilot's status, or the vehicle behind it, is silent for long, or not known armed.

        A node that was started again and has never heard the vehicle says that nothing is known of it.
        """
        peers = self.state.peers
        vehicle_ns = peers.vehicle_unknown_ns if peers.link_ns is None else peers.link_ns
        heard = [each for each in (peers.autopilot_ns, vehicle_ns, peers.armed_unknown_ns) if each is not None]
        return not heard or self.now - min(heard) >= self.limits.pilot_silence_limit_ns

    def disarmed_for_long(self) -> bool:
        """Return True when the vehicle has said for long that it is disarmed, wherever it says that it stands."""
        agreed, limit_ns = self.state.vehicle.disarmed, self.limits.pilot_silence_limit_ns
        return agreed is not None and self.now - agreed.since_ns >= limit_ns and self.disarmed()

    def armed(self) -> bool:
        """Return True when the vehicle says, freshly, that it is armed."""
        status = self.vehicle()
        return status is not None and status.armed is True

    def disarmed(self) -> bool:
        """Return True when the vehicle says, freshly, that it is disarmed."""
        status = self.vehicle()
        return status is not None and status.armed is False

    def down(self) -> bool:
        """Return True when the vehicle says, freshly, both disarmed and ON_GROUND. Unknown is not down."""
        status = self.vehicle()
        return status is not None and status.armed is False and status.landed is VehicleLanded.ON_GROUND

    def stays_down(self) -> bool:
        """Return True when several statuses agree that it is disarmed and ON_GROUND: only that ends a flight.

        What the landing detection or the height says against it is outweighed after `confirm_limit_ns` alone.
        """
        agreed, limits = self.state.vehicle.down, self.limits
        if agreed is None or not self.down():
            return False
        return agreed.lasts(limits.confirm_limit_ns if self.seems_to_fly() else limits.flight_end_confirm_ns)

    def seems_to_fly(self) -> bool:
        """Return True when landing detection or height contradicts that it stands on the ground."""
        status, detection = self.vehicle(), self.detection()
        high = status is not None and status.height_m is not None and status.height_m >= self.limits.takeoff_height_m
        return detection is Landed.AIRBORNE or (high and detection is not Landed.ON_GROUND)

    def contradicted(self) -> bool:
        """Return True when something contradicts that it stands on the ground, or did a moment ago.

        A range finder may see nothing for a moment: the landing detection's word of before it still counts.
        """
        last_ns = self.state.vehicle.contradicted_ns
        lately = last_ns is not None and self.now - last_ns < self.limits.ground_disarm_after_ns
        return lately or self.seems_to_fly()

    def planner_flew(self) -> bool:
        """Return True when the planner has said, since the takeoff command, that it flew on to its waypoints."""
        planner, started_ns = self.state.peers.planner, self.state.flight.started_ns
        if planner is None or started_ns is None or not planner.t_ns > started_ns:
            return False
        return planner.phase in _FLEW and planner.waypoint > 0

    def stands(self) -> bool:
        """Return True when it has said ON_GROUND for longer than one wrong status lasts."""
        since, last = self.state.flight.grounded_ns, self.state.peers.autopilot_ns
        agreed = since is not None and last is not None and last - since >= self.limits.flight_end_confirm_ns
        return agreed and self.on_ground()

    def taken(self) -> bool:
        """Return True when several statuses, the last one among them, agree that somebody else has control."""
        agreed, status = self.state.vehicle.takeover, self.vehicle()
        if agreed is None or agreed.statuses < 2:  # noqa: PLR2004 - a single one is not enough
            return False
        if status is None or status.armed is False:
            return False
        return self.now - agreed.since_ns >= self.limits.pilot_confirm_ns

    def suspected(self) -> bool:
        """Return True while it is not clear whether somebody else has control: nothing is commanded meanwhile."""
        doubted = self.state.vehicle.takeover is not None and self.vehicle() is not None and not self.taken()
        return doubted or self.unheard()

    def unheard(self) -> bool:
        """Return True after a restart in flight until the autopilot is heard, or lost: who has control is not known."""
        peers = self.state.peers
        if not self.state.flight.active or peers.autopilot is not None or peers.autopilot_ns is None:
            return False
        return self.now - peers.autopilot_ns <= self.limits.autopilot_status_limit_ns

    def lands(self) -> bool:
        """Return True when it is landing, whoever lands it: a hold must not interrupt that."""
        status = self.vehicle()
        if self.state.peers.planner is None or self.planner_lands():
            return True  # right after a restart of ours it was not heard yet
        if status is None:
            return False
        if status.mode in LANDING_MODES or status.landed is VehicleLanded.LANDING:
            return True
        low = status.height_m is not None and abs(status.height_m) <= self.limits.landing_height_m
        since = self.state.vehicle.descending_ns
        return low and since is not None and self.now - since >= self.limits.descent_time_ns

    def planner_lands(self) -> bool:
        """Return True when the planner says that it lands by itself, or has landed."""
        planner = self.state.peers.planner
        return planner is not None and planner.phase in (MissionPhase.LANDING, MissionPhase.LANDED)

    def holds(self) -> bool:
        """Return True when flight mode or standing still shows a hold: the planner's word alone does not.

        A mode lasts until it is changed; that it stood still says nothing any more when it was told a while ago. What
        climbs or sinks does not stand still, nor does what does not say both speeds.
        """
        status, heard_ns = self.vehicle(), self.state.peers.autopilot_ns
        if status is None or heard_ns is None:
            return False
        told = None not in (status.horizontal_speed_m_s, status.vertical_speed_m_s)
        stands = told and not fast(status, self.limits.hold_speed_m_s)
        return status.mode in HOLDING_MODES or (stands and self.now - heard_ns <= self.limits.hold_speed_age_limit_ns)

    def last_heard_down(self) -> bool:
        """Return True when the last word of the vehicle was disarmed and ON_GROUND, however old.

        Enough for a person who stands beside a vehicle that was switched off and acknowledges that it has landed.
        """
        status = self.state.peers.autopilot
        return status is not None and status.armed is False and status.landed is VehicleLanded.ON_GROUND

    def on_ground(self) -> bool:
        """Return True when the vehicle says, freshly, ON_GROUND."""
        status = self.vehicle()
        return status is not None and status.landed is VehicleLanded.ON_GROUND

    def may_arm_late(self) -> bool:
        """Return True while an ARM of ours may still take effect, although its takeoff was called off."""
        state = self.state
        called_off = bool(state.flight.commanded) and not state.flight.active and not state.flight.was_airborne
        return called_off and self.now - state.flight.motion.sent_ns <= self.limits.arm_limit_ns

    def detection(self) -> Landed:
        """Return what the landing detection says, freshly; UNKNOWN when it is silent."""
        status, seen_ns = self.state.peers.landing, self.state.peers.landing_ns
        if status is None or seen_ns is None or self.now - seen_ns > self.limits.landing_detection_limit_ns:
            return Landed.UNKNOWN
        return status.landed

    def tells_place(self) -> bool:
        """Return True when the vehicle says, freshly, whether it stands on the ground."""
        return self.airborne() or self.on_ground()

    def airborne(self) -> bool:
        """Return True when the vehicle says, freshly, that it has left the ground."""
        status = self.vehicle()
        return status is not None and status.landed not in (VehicleLanded.ON_GROUND, VehicleLanded.UNKNOWN)

    def never_landed(self) -> bool:
        """Return True where a flight that seemed over goes on: in the air, and nothing shows that it is another one."""
        return self.state.flight.was_airborne and self.airborne() and not self.state.flight.another

    def flies_again(self) -> bool:
        """Return True when the vehicle says, freshly, what contradicts that its flight is over."""
        status = self.vehicle()
        return status is not None and (status.armed is True or (self.airborne() and status.armed is not False))
