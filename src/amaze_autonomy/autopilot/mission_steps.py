"""What is sent for each command of a mission, and how the vehicle shows that it has done it: a table of steps.

`procedure.py` does them one after the other.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Callable, Mapping, NamedTuple, Optional, Set, Tuple

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.missions import Controller

from .dialect import Message, mavlink
from .mission_items import Dialect, beginning
from .mission_vehicle import AIRBORNE, HOLD, LAND, MISSION, OFFBOARD, VehicleWatch

__all__ = ["Means", "Step", "steps_of"]

_SET_MODE, _ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
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
    """

    name: str
    done: Callable[[Means, int], bool]
    message: Callable[[Means], Optional[Message]]
    command: int = 0
    mode: str = ""
    always: bool = True
    only: Optional[Dialect] = None
    limited: bool = True


# --- steps ------------------------------------------------------------------------------------------------------------


def _long(watch: VehicleWatch, command: int, *values: float) -> Message:
    padded = (*values, *(0.0,) * (7 - len(values)))
    return mavlink.MAVLink_command_long_message(*watch.target, command, 0, *padded)


def _mode_message(means: Means, mode: str) -> Optional[Message]:
    numbers = means.watch.numbers(mode)
    if numbers is None:
        return None
    means.commanded.add(mode)
    return _long(means.watch, _SET_MODE, 1.0, *map(float, numbers))


def _enter(mode: str) -> Step:
    def message(means: Means) -> Optional[Message]:
        return _mode_message(means, mode)

    return Step(f"change to {mode}", lambda means, _: means.watch.mode == mode, message, _SET_MODE, mode)


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
)


def _began(means: Means, command: int) -> bool:
    """Return whether ArduPilot leaves the ground; its takeoff takes longer to show than a command may."""
    return means.watch.landed in AIRBORNE or means.watch.results.get(command) == "MAV_RESULT_ACCEPTED"


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
_PREPARE = Step(
    "change to a mode to arm in",
    lambda means, _: means.watch.mode == _prepare(means),
    lambda means: _mode_message(means, _prepare(means)),
    _SET_MODE,
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
    lambda means, _: _began(means, _TAKE_OFF),
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
#: ArduPilot is sent to it also where it is there already: it has forgotten its heading; what it says then is the item
#: that it was told, and the waypoint behind it from then on
_TURN = Step(
    "return to the item where it stopped, and to its heading",
    lambda means, _: means.resume_item is None or means.watch.current in (means.resume_item, _beginning(means)),
    lambda means: (
        None
        if means.resume_item is None
        else mavlink.MAVLink_mission_set_current_message(*means.watch.target, _beginning(means))
    ),
    only=Dialect.ARDUPILOT,
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
    (Controller.MISSION, MissionAction.TAKEOFF): (_VERIFY, _PREPARE, _ARMING, _enter(MISSION), _BEGIN),
    (Controller.MISSION, MissionAction.HOLD): (_enter(HOLD),),
    (Controller.MISSION, MissionAction.RESUME): (_ITEM, _TURN, _enter(MISSION), _BEGIN),
    (Controller.MISSION, MissionAction.LAND): (_enter(LAND),),
    (Controller.MISSION, MissionAction.ABORT): (_DISARMING,),  # on the ground; airborne it is LAND
    (Controller.OFFBOARD, MissionAction.TAKEOFF): (_STREAM, _enter(OFFBOARD), _ARMING, _LIFT),
    (Controller.OFFBOARD, MissionAction.HOLD): (_STREAM, _enter(OFFBOARD), _STILL),
    (Controller.OFFBOARD, MissionAction.RESUME): (_STREAM, _enter(OFFBOARD)),
    (Controller.OFFBOARD, MissionAction.LAND): (_enter(LAND),),
    (Controller.OFFBOARD, MissionAction.ABORT): (_DISARMING,),
}


def steps_of(controller: Controller, action: MissionAction, dialect: Dialect) -> Tuple[Step, ...]:
    """Return what is done for a command, one after the other."""
    return tuple(step for step in _STEPS[controller, action] if step.only in (None, dialect))
