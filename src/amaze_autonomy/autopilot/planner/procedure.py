"""Whether a command of a mission is taken, what is sent for it, and how the vehicle shows that it has done it. Pure.

Two tables: in which phases a command is taken, and its steps, which are done one after the other.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from typing import Callable, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase, VehicleLanded
from amaze_autonomy.missions import Controller, PlannerSpec

from ..link.dialect import Message, mavlink
from ..vehicle.agreement import Agreement
from ..vehicle.modes import HOLD, LAND, LANDING_MODES, is_foreign
from .loading import BEGINS_ANEW, NO_POSE
from .mission_upload import Dialect, beginning
from .mission_vehicle import AIRBORNE, MISSION, MODE_LATE_NS, OFFBOARD, SILENT, VehicleWatch

_SET_MODE, _ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
_HOME_TOLERANCE_M = 1.0  # of its height where a mission takes off: as far as an estimate of height may be off there
_START, _TAKE_OFF = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_NAV_TAKEOFF


@dataclass
class Means:
    """What steps look at besides the vehicle.

    Args:
        watch: the vehicle.
        lead_ns: how long set-points must have been sent.
        takeoff_height_m: of a climb by command.
        resume_item: item of the mission to go on with; None: whatever the autopilot says.
        stream_ns: since when set-points are sent; None: they are not.
        still: the vehicle stands still by set-points.
        lifted: the vehicle has been in the air, its takeoff over.
        verified: the mission on the vehicle was read again, and is the one that was sent.
        grounded: the vehicle says, within the last moment, that it is on the ground.
        commanded: the modes that were commanded in this flight.
    """

    watch: VehicleWatch
    lead_ns: int
    takeoff_height_m: float = 0.0
    resume_item: Optional[int] = None
    stream_ns: Optional[int] = None
    still: bool = False
    lifted: bool = False
    verified: bool = False
    grounded: bool = False
    commanded: Set[str] = field(default_factory=set)

    @property
    def streams(self) -> bool:
        """False where no set-point may be sent yet: one during ArduPilot's own takeoff would end it."""
        return self.watch.dialect is Dialect.PX4 or self.lifted


class Step(NamedTuple):
    """One thing to be done.

    Args:
        name: in words.
        done: whether the vehicle shows it; called with the means and the time.
        message: what is sent; None: nothing has to be.
        command: MAV_CMD whose acknowledgement gives the reason; 0: none.
        mode: that it leads to; empty: none.
        always: sent even when the vehicle shows it already, because another command may be under way.
        only: the autopilots that need it; None: all.
        limited: given up after the limit of a command; False: it has a limit of its own.
        agreed: whether more than one message shows it; until then nothing is sent while the last one does.
        why: why it does not show, in words; empty: nobody knows more than that.
        said_ns: when the vehicle said last what shows it; None: by its heartbeat, or its flight mode.
        without: what is left out, in words, where it goes on after a while all the same; None: it does not.
    """

    name: str
    done: Callable[[Means, int], bool]
    message: Callable[[Means], Optional[Message]]
    command: int = 0
    mode: str = ""
    always: bool = True
    only: Optional[Dialect] = None
    limited: bool = True
    agreed: Callable[[Means], bool] = lambda _: True
    why: Callable[[Means], str] = lambda _: ""
    said_ns: Optional[Callable[[Means], Optional[int]]] = None
    without: Callable[[Means], Optional[str]] = lambda _: None


# --- steps ------------------------------------------------------------------------------------------------------------


def _long(watch: VehicleWatch, command: int, *values: float) -> Message:
    padded = (*values, *(0.0,) * (7 - len(values)))
    return mavlink.MAVLink_command_long_message(*watch.target, command, 0, *padded)


def _mode_message(means: Means, mode: str) -> Optional[Message]:
    numbers = means.watch.numbers(mode)
    if numbers is None:
        return None
    means.commanded.add(mode)
    means.watch.control.command(mode)
    return _long(means.watch, _SET_MODE, 1.0, *map(float, numbers))


def _enter(mode: str) -> Step:
    def message(means: Means) -> Optional[Message]:
        return _mode_message(means, mode)

    return Step(f"change to {mode}", lambda means, _: means.watch.mode == mode, message, _SET_MODE, mode)


def _lands(means: Means, t_ns: int) -> bool:
    """Return whether it says, freshly, that it is in the landing mode; an older word holds no landing back."""
    mode_ns = means.watch.mode_ns
    return means.watch.mode == LAND and mode_ns is not None and t_ns - mode_ns <= MODE_LATE_NS


_LANDING = _enter(LAND)._replace(done=_lands, agreed=lambda means: means.watch.in_land)


def _prepare(means: Means) -> str:
    """Return the mode to arm in."""
    return HOLD if means.watch.dialect is Dialect.PX4 else OFFBOARD


_ARMING = Step("arm", lambda means, _: means.watch.armed is True, lambda means: _long(means.watch, _ARM, 1.0), _ARM)
#: never on a landed state that is old: the vehicle may have lifted off since
_DISARMING = Step(
    "disarm",
    lambda means, _: means.watch.armed is False,
    lambda means: _long(means.watch, _ARM, 0.0) if means.grounded else None,
    _ARM,
    agreed=lambda means: means.watch.ground.disarmed,
)


def _above_home_m(means: Means) -> Optional[float]:
    """Return how high above home it says that it is since it was armed; None: it has not said it."""
    watch, armed_ns = means.watch, means.watch.ground.armed_ns
    return watch.height_m if armed_ns is not None and watch.place_ns > armed_ns else None


def _is_home(means: Means, _: int) -> bool:
    above_m = _above_home_m(means)
    on_ground = means.watch.landed is VehicleLanded.ON_GROUND
    return on_ground and above_m is not None and abs(above_m) <= _HOME_TOLERANCE_M


def _is_off(means: Means) -> bool:
    return means.lifted or means.watch.landed in AIRBORNE


def _why_not_home(means: Means) -> str:
    above_m = _above_home_m(means)
    if above_m is None:
        return "no height above home has come since it was armed"
    if abs(above_m) <= _HOME_TOLERANCE_M:
        return "the vehicle does not say that it is on the ground"
    return f"home is {abs(above_m):.1f} m {'below' if above_m > 0 else 'above'} where it stands: set home here"


def _began(means: Means, command: int) -> bool:
    """Return whether ArduPilot leaves the ground; its takeoff takes longer to show than a command may."""
    return means.watch.is_aloft or means.watch.results.get(command) == "MAV_RESULT_ACCEPTED"


def _beginning(means: Means) -> int:
    return beginning(means.resume_item or 0, means.watch.dialect)


def _lift_message(means: Means) -> Message:
    return _long(means.watch, _TAKE_OFF, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, means.takeoff_height_m)


_VERIFY = Step(
    "mission read back before the takeoff",
    lambda means, _: means.verified,
    lambda _: None,
    always=False,
    limited=False,
)
_UNCHANGED = _VERIFY._replace(name="mission read back before it goes on")
_PREPARE = Step(
    "change to a mode to arm in",
    lambda means, _: means.watch.mode == _prepare(means),
    lambda means: _mode_message(means, _prepare(means)),
    _SET_MODE,
)
#: The heights of a mission count from home. It is set anew by the arming, unless somebody has set (PX4) or locked
#: (ArduPilot) it: so it is looked at armed, and what it was before may still be told for a moment.
_HOME = Step("home where it stands", _is_home, lambda _: None, always=False, why=_why_not_home)
#: a hold before lift-off ends the takeoff, and may be resumed
_HOME_ON_GROUND = _HOME._replace(done=lambda means, t_ns: _is_off(means) or _is_home(means, t_ns))
#: The height of ArduPilot's takeoff by command counts from home, too; one that never tells a height above home has no
#: home, and counts from where it arms.
_HOME_OF_LIFT = _HOME._replace(
    done=lambda means, t_ns: _is_off(means) or not means.watch.place_ns or _is_home(means, t_ns),
    only=Dialect.ARDUPILOT,
)
#: ArduPilot in AUTO stays on the ground until it is told to begin, and in GUIDED until it is told to take off
_BEGIN = Step(
    "start of the mission",
    lambda means, _: _began(means, _START),
    lambda means: _long(means.watch, _START),
    _START,
    always=False,
    only=Dialect.ARDUPILOT,
)
_LIFT = Step(
    "takeoff",
    lambda means, _: means.lifted or _began(means, _TAKE_OFF),
    _lift_message,
    _TAKE_OFF,
    always=False,
    only=Dialect.ARDUPILOT,
)
_ITEM = Step(
    "return to the item where it stopped",
    lambda means, _: means.resume_item is None or means.watch.current == means.resume_item,
    lambda means: mavlink.MAVLink_mission_set_current_message(*means.watch.target, means.resume_item or 0),
    always=False,
    only=Dialect.PX4,
)


def _turns(means: Means) -> bool:
    """Return whether a turn stands before the item where it stopped."""
    return means.resume_item is not None and _beginning(means) != means.resume_item


def _without_turn(means: Means) -> Optional[str]:
    """Return what a mission goes on without that is at its waypoint, and was not sent back to the turn before it."""
    there = _turns(means) and means.watch.current in (means.resume_item, _beginning(means))
    return "it goes on without the heading of its waypoint" if there else None


#: ArduPilot is sent to it also where it is there already: it has forgotten its heading; what it says then is the item
#: that it was told, and the waypoint behind it from then on. That one it said before as well: it shows nothing
_TURN = Step(
    "return to the item where it stopped, and to its heading",
    lambda means, _: means.resume_item is None or means.watch.current == _beginning(means),
    lambda means: (
        None
        if means.resume_item is None
        else mavlink.MAVLink_mission_set_current_message(*means.watch.target, _beginning(means))
    ),
    only=Dialect.ARDUPILOT,
    said_ns=lambda means: means.watch.current_ns if _turns(means) else means.watch.heartbeat_ns,
    without=_without_turn,
)
_STREAM = Step(
    "stream of set-points",
    lambda means, t_ns: not means.streams or (means.stream_ns is not None and t_ns - means.stream_ns >= means.lead_ns),
    lambda _: None,
    always=False,
)
_STILL = Step("stop", lambda means, _: means.still or not means.streams, lambda _: None, always=False)

_Key = Tuple[Controller, MissionAction]
_STEPS: Mapping[_Key, Tuple[Step, ...]] = {
    (Controller.MISSION, MissionAction.TAKEOFF): (_VERIFY, _PREPARE, _ARMING, _HOME, _enter(MISSION), _BEGIN),
    (Controller.MISSION, MissionAction.HOLD): (_enter(HOLD),),
    (Controller.MISSION, MissionAction.RESUME): (_UNCHANGED, _HOME_ON_GROUND, _ITEM, _TURN, _enter(MISSION), _BEGIN),
    (Controller.MISSION, MissionAction.LAND): (_LANDING,),
    (Controller.MISSION, MissionAction.ABORT): (_DISARMING,),  # on the ground; airborne it is LAND
    (Controller.OFFBOARD, MissionAction.TAKEOFF): (_STREAM, _enter(OFFBOARD), _ARMING, _HOME_OF_LIFT, _LIFT),
    (Controller.OFFBOARD, MissionAction.HOLD): (_STREAM, _enter(OFFBOARD), _STILL),
    # the last two are for a takeoff that was held
    (Controller.OFFBOARD, MissionAction.RESUME): (_STREAM, _enter(OFFBOARD), _HOME_OF_LIFT, _LIFT),
    (Controller.OFFBOARD, MissionAction.LAND): (_LANDING,),
    (Controller.OFFBOARD, MissionAction.ABORT): (_DISARMING,),
}


def steps_of(controller: Controller, action: MissionAction, dialect: Dialect) -> Tuple[Step, ...]:
    """Return what is done for a command, one after the other."""
    return tuple(step for step in _STEPS[controller, action] if step.only in (None, dialect))


# --- procedure --------------------------------------------------------------------------------------------------------
# Does the steps of a command one after the other.
#
# A step is sent, sent again until a heartbeat that came after it shows its effect, and given up at its limit.
# Acknowledgements only give the reason: PX4 sends two for one change of mode (ACCEPTED, then TEMPORARILY_REJECTED),
# and for some commands none.
#
# While a step waits, the vehicle may fall into a mode that somebody else chose. Then it is the pilot's or the
# failsafe's, and nothing more is sent from its first sign on. The same where somebody else lands it. One message may be
# wrong: the command is over when several agree, and goes on when the next one says otherwise; a takeoff is over at
# once, while what it has armed can be disarmed on the ground. What waits ends with a silence of the
# vehicle, a landing excepted: nobody knows what has become of the vehicle meanwhile, and whoever commanded it must
# say what is next.


_SILENT_NS = 1_500_000_000  # longer than between two heartbeats
_OVERTAKEN_NS = 300_000_000  # so much later than the mode that we chose the one before may be told: packets overtake
_WITHOUT_NS = 1_000_000_000  # so long it waits for what a command may go on without; sent again meanwhile
_NO_REASONS = ("MAV_RESULT_ACCEPTED", "MAV_RESULT_IN_PROGRESS")


class Progress(enum.Enum):
    """How far a procedure is."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    TAKEN = "taken"  # somebody else has chosen another mode
    SILENT = "silent"  # the vehicle, or its flight mode, was not heard for too long


class Procedure:
    """Does steps one after the other.

    Args:
        action: that it carries out.
        steps: of it.
        means: what they look at.
        spec: pauses and limits.
        t_ns: now.
        persistent: goes on after its limit, and through a silence (a landing).
    """

    def __init__(
        self,
        action: MissionAction,
        steps: Sequence[Step],
        means: Means,
        spec: PlannerSpec,
        t_ns: int,
        *,
        persistent: bool = False,
    ) -> None:
        self.action, self.progress, self.reason = action, Progress.RUNNING, ""
        self._steps, self._means, self._spec, self._persistent = tuple(steps), means, spec, persistent
        self._number = 0
        self._start_mode = means.watch.mode
        self._was_ours = not persistent and means.watch.mode in means.commanded  # what it leaves, somebody else takes
        self.begun_ns = self._since_ns = self._woken_ns = t_ns
        self.longest_pause_ns = 0  # for which this process stood still
        self._sent_ns: float = -math.inf
        self._first_ns: float = math.inf
        self.changes_mode = False  # a change of mode was sent
        self._answered_ns = t_ns  # when the first mode that was commanded here was shown
        self._left_out = ""  # what it went on without, in words
        self._others = Agreement()  # on somebody else who has chosen what the vehicle does
        self._forget_result()

    @property
    def running(self) -> bool:
        """True until it has ended."""
        return self.progress is Progress.RUNNING

    def wake(self, t_ns: int, *, sends: bool = True) -> List[Message]:
        """Look at the vehicle and the time; return what is to be sent, where something may be."""
        if not self.running:
            return []
        limit_ns = self._spec.vehicle_age_limit_ns
        unknown = self._means.watch.unknown(t_ns, limit_ns)
        if unknown and not self._persistent:
            silent = f"the vehicle was silent for {limit_ns / 1e9:g} s"
            return self._end(Progress.SILENT, silent if unknown == SILENT else unknown)
        self._pause(t_ns)
        while self._is_over(t_ns):
            self._answered_ns = self._answered_ns if self._answered else t_ns
            self._number += 1
            if self._number == len(self._steps):
                return self._end(Progress.DONE)
            self._since_ns, self._sent_ns, self._first_ns = t_ns, -math.inf, math.inf
            self._forget_result()
        heard = self._means.watch.tells_mode(t_ns, limit_ns)
        taken, said_ns = self._taken() if heard else ("", t_ns)
        self._others.add(said_ns, so=bool(taken))
        agreed = self._others.lasts(self._means.watch.limits.pilot_confirm_ns)
        if agreed or (taken and self.action is MissionAction.TAKEOFF):
            return self._end(Progress.TAKEN, taken)
        if self._steps[self._number].limited and t_ns - self._since_ns >= self._spec.command_limit_ns:
            self._late(t_ns)
        watch = self._means.watch
        blind = not heard and watch.pilot  # the last that was heard: whether he still flies is not known
        blind = blind or self._is_overtaken()
        hands_off = taken or blind or (watch.armed and watch.may_be_pilot) or self._asks() or self._shown(t_ns)
        return self._send(t_ns) if sends and self.running and not hands_off else []

    def stood_still(self, duration_ns: int) -> None:
        """Take that this process stood still: nothing could be seen meanwhile, and no limit has run."""
        self.longest_pause_ns = max(self.longest_pause_ns, duration_ns)
        self._since_ns += duration_ns
        self._woken_ns += duration_ns

    def fail(self, reason: str) -> None:
        """End it: it cannot be done."""
        if self.running:
            self.progress, self.reason = Progress.FAILED, reason

    def _end(self, progress: Progress, why: str = "") -> List[Message]:
        self.progress = progress
        self.reason = f"{self.action.name.lower()} ended: {why}" if why else self._left_out
        return []

    def _forget_result(self) -> None:
        """Forget how an earlier command was acknowledged."""
        self._means.watch.results.pop(self._steps[self._number].command, None)

    def _pause(self, t_ns: int) -> None:
        """Stop the clock of the limit while the vehicle is silent: nothing can show then."""
        passed_ns, self._woken_ns = t_ns - self._woken_ns, t_ns
        if not self._means.watch.known(t_ns, _SILENT_NS):
            self._since_ns += passed_ns

    def _is_over(self, t_ns: int) -> bool:
        """Return whether the step is done, or was waited for in vain, and what it is for may be left out."""
        step = self._steps[self._number]
        if self._shown(t_ns):
            return step.agreed(self._means)
        without = step.without(self._means) if t_ns - max(self._since_ns, self._first_ns) >= _WITHOUT_NS else None
        self._left_out = without or self._left_out
        return without is not None

    def _shown(self, t_ns: int) -> bool:
        """Return whether the vehicle shows the effect, by a heartbeat (a mode: CURRENT_MODE, too) after the command.

        A mode that is shown is not sent again: a pilot may choose another one in the second until the next heartbeat.
        Nor is a hold of ours that a failsafe may have taken for its own.
        """
        step, watch = self._steps[self._number], self._means.watch
        said_ns = watch.mode_ns if step.mode else watch.heartbeat_ns
        said_ns = said_ns if step.said_ns is None else step.said_ns(self._means)
        after = not step.always or (said_ns is not None and said_ns > self._first_ns)
        kept = self.action is MissionAction.HOLD and watch.control.may_wait and not watch.control.acts_unasked
        return (after or kept) and step.done(self._means, t_ns)

    def _ends_a_failsafe(self) -> bool:
        """Return whether a failsafe holds, or may hold, that any mode of this command would end."""
        control = self._means.watch.control
        if self.action is MissionAction.TAKEOFF:  # armed in a hold, which the engine takes for a failsafe's then
            return self._means.watch.mode == HOLD and control.failsafe
        if self.action is MissionAction.RESUME:
            return control.may_wait
        return self.action is MissionAction.HOLD and control.acts_unasked

    def _asks(self) -> bool:
        """Return whether a heartbeat must say first whether the hold that shows is a failsafe's."""
        watch, ends = self._means.watch, self.action in (MissionAction.HOLD, MissionAction.RESUME)
        return ends and watch.mode == HOLD and watch.control.unexplained

    @property
    def _answered(self) -> bool:
        """Return whether the vehicle has shown a mode that was commanded here: from then on any other is not ours."""
        return any(step.command == _SET_MODE for step in self._steps[: self._number])

    def _is_overtaken(self) -> bool:
        """Return whether the mode of before may have been said before ours, and came after it; the next one tells."""
        watch = self._means.watch
        before = watch.latest_mode == self._start_mode and watch.latest_mode not in self._means.commanded
        return before and self._answered and watch.latest_ns - self._answered_ns <= _OVERTAKEN_NS

    def _taken(self) -> Tuple[str, int]:
        """Return who has chosen what the vehicle does, in words, and when it said so; empty: nobody but us."""
        watch, step, mode_ns = self._means.watch, self._steps[self._number], self._means.watch.mode_ns or 0
        if self._answered and watch.latest_mode not in self._means.commanded and not self._is_overtaken():
            return f"the vehicle went to {watch.latest_mode} by itself", watch.latest_ns
        if watch.armed and not is_foreign(watch.mode) and self._ends_a_failsafe():
            return f"the autopilot acts by its failsafe (mode {watch.mode})", mode_ns
        if watch.mode == step.mode:
            return "", mode_ns
        if watch.armed and not self._persistent and (watch.mode in LANDING_MODES or watch.lands):
            told_ns = mode_ns if watch.mode in LANDING_MODES else watch.landed_ns or 0
            return f"the vehicle lands (mode {watch.mode})", told_ns
        if watch.mode == self._start_mode:  # a vehicle stands in any mode before it is armed
            taken = bool(watch.armed) and watch.pilot
        else:
            other = bool(watch.armed) and watch.mode not in self._means.commanded
            left = other and self._was_ours
            taken = is_foreign(watch.mode) or (other and watch.failsafe) or left
        return f"the vehicle went to {watch.mode} by itself" if taken else "", mode_ns

    def _late(self, t_ns: int) -> None:
        step, watch = self._steps[self._number], self._means.watch
        result = watch.results.get(step.command, "")
        answer = "" if result in _NO_REASONS else result.replace("MAV_RESULT_", "", 1)
        shown = f"mode {watch.mode or 'unknown'}, {'armed' if watch.armed else 'not armed'}"
        said = watch.complaints(t_ns, self._since_ns)
        limit_s, words = self._spec.command_limit_ns / 1e9, f": {'; '.join(said)}" if said else ""
        why = step.why(self._means)
        self.reason = why or f"{step.name}: not shown within {limit_s:g} s ({answer or shown}){words}"
        if not self._persistent:
            self.progress = Progress.FAILED

    def _send(self, t_ns: int) -> List[Message]:
        """Send it, to nobody before the first heartbeat: numbers of flight modes are each autopilot's own."""
        if self._means.watch.heartbeat_ns is None or t_ns - self._sent_ns < self._spec.command_retry_ns:
            return []
        step = self._steps[self._number]
        message = step.message(self._means)
        self._first_ns = min(self._first_ns, t_ns)
        if message is None:
            return []
        self._sent_ns, self.changes_mode = t_ns, self.changes_mode or step.command == _SET_MODE
        return [message]


# --- admission --------------------------------------------------------------------------------------------------------
# LAND and ABORT are taken always, of a silent vehicle as well: only a pilot who is seen to fly is a reason against
# them.


#: phases in which a command is taken; any other refuses it. LAND and ABORT are taken always.
_GOOD_IN: Mapping[MissionAction, Tuple[MissionPhase, ...]] = {
    MissionAction.TAKEOFF: (MissionPhase.LOADED,),
    MissionAction.HOLD: (MissionPhase.TAKING_OFF, MissionPhase.FLYING, MissionPhase.HOLDING),
    MissionAction.RESUME: (MissionPhase.TAKING_OFF, MissionPhase.FLYING, MissionPhase.HOLDING),
}
_WORDS: Mapping[MissionAction, str] = {
    MissionAction.TAKEOFF: "fly",
    MissionAction.HOLD: "hold",
    MissionAction.RESUME: "resume",
}


class Standing(NamedTuple):
    """How it is when a command comes.

    Args:
        watch: the vehicle.
        tells_mode: it has told its flight mode lately.
        unknown: what nobody knows of it that must be known, in words; empty: nothing.
        phase: of the planner.
        session_id: that is loaded; None: none is.
        lost: the local position is needed for a takeoff, and is not there.
        landing: why the vehicle is landed, whatever else is asked for, in words; empty: it is not.
        other: what the autopilot node commands; empty: nothing.
        restarts: its mission would begin anew after a hold.
        steered: who has chosen the mode that it flies in, as messages agree, in words; empty: this planner.
        moved: who has moved it in its hold, or its mission or its home, in words; empty: nobody.
        begun_anew: why its local frame is not the one of the origin any more, in words; empty: it is, or not needed.
        misplaced: why the file is not taken off with as and where the vehicle stands, in words; empty: it is.
    """

    watch: VehicleWatch
    tells_mode: bool
    unknown: str
    phase: MissionPhase
    session_id: Optional[str]
    lost: bool
    landing: str = ""
    other: str = ""
    restarts: bool = False
    steered: str = ""
    moved: str = ""
    begun_anew: str = ""
    misplaced: str = ""


def refusal(standing: Standing, session_id: str, action: MissionAction) -> str:
    """Return why a command is refused; empty when it is taken."""
    watch = standing.watch
    if standing.tells_mode and watch.armed and watch.pilot:
        return f"the pilot has control (mode {watch.mode})"
    if standing.tells_mode and watch.armed and watch.may_be_pilot:
        return f"a pilot may have control (mode {watch.mode}): whether a transmitter is heard is not known yet"
    if action not in _GOOD_IN:
        return ""
    return _landed_or_silent(standing) or _out_of_place(standing, session_id, action) or _unfit(standing, action)


def _landed_or_silent(standing: Standing) -> str:
    if standing.unknown:
        return standing.unknown
    return f"{standing.landing}: it stands until the vehicle is disarmed" if standing.landing else ""


def _out_of_place(standing: Standing, session_id: str, action: MissionAction) -> str:
    if session_id != standing.session_id:
        return f"session {session_id!r} is not the one that is loaded"
    if standing.phase not in _GOOD_IN[action]:
        return f"there is nothing to {_WORDS[action]} in phase {standing.phase.name}"
    if action is not MissionAction.TAKEOFF and not standing.watch.armed:
        return f"there is nothing to {_WORDS[action]} on the ground: ABORT cancels the takeoff"
    return ""


def _unfit(standing: Standing, action: MissionAction) -> str:
    watch, takes_off = standing.watch, action is MissionAction.TAKEOFF
    if watch.armed and is_foreign(watch.mode):
        return f"the autopilot flies by itself (mode {watch.mode})"
    control = watch.control
    if not takes_off and (control.acts_unasked or (action is MissionAction.RESUME and control.may_wait)):
        return f"the autopilot acts by its failsafe (mode {watch.mode})"
    if not takes_off and standing.steered and not control.unexplained:
        return standing.steered
    if not takes_off and (watch.mode in LANDING_MODES or watch.lands):
        return f"the vehicle lands (mode {watch.mode})"
    if action is MissionAction.RESUME and standing.moved:
        return standing.moved
    if takes_off and standing.other:
        return f"the autopilot node commands {standing.other}"
    if takes_off and standing.restarts:
        return BEGINS_ANEW
    if takes_off and standing.begun_anew:
        return f"load it again: {standing.begun_anew}"
    return (NO_POSE if standing.lost else standing.misplaced) if takes_off else ""
