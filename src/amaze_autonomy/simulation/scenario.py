"""What a scenario says: faults and user's requests, each with its trigger. The table of all kinds of faults is here.

Every fault acts on a sample, a process, a reply, the vehicle or a person; what the engine sees follows from that. No
fault writes a code, a condition or a verdict.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Dict, Mapping, Optional, Tuple, Union

from amaze_autonomy.engine.events import UserCommand

_Value = Union[float, str]


class Subject:
    """What a fault can be about: the key that names its target, or WORLD when there is only one of it."""

    COMPONENT = "component"
    PROCESS = "process"
    SERVICE = "service"
    WORLD = ""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a kind of fault.

    Args:
        name: with its unit, as in the file.
        default: its value when it is not given; None: it must be given.
        low: smallest value of a number.
        high: largest value of a number.
        choices: what a word may be; empty: a number, or any word when the default is a word.
        words: what it means.
        pattern: regular expression that a word matches; empty: a name.
    """

    name: str
    default: Optional[_Value]
    words: str
    low: float = 0.0
    high: float = 1e9
    choices: Tuple[str, ...] = ()
    pattern: str = ""

    @property
    def is_number(self) -> bool:
        """True for a number, false for a word."""
        return not self.choices and not self.pattern and not isinstance(self.default, str)


@dataclass(frozen=True)
class FaultKind:
    """One kind of fault.

    Args:
        subject: what it is about.
        name: as in the file.
        words: what it does to the world.
        parameters: what can be said of it.
        targets: which processes or services it can be about; empty: any.
    """

    subject: str
    name: str
    words: str
    parameters: Tuple[Parameter, ...] = ()
    targets: Tuple[str, ...] = ()


ENGINE = "autonomy"
"""The process that is not part of the world: faults of it are for those who run engine and world together."""

_RESTART = (
    Parameter("restart", "succeeds", "what comes of restarting it", choices=("succeeds", "fails")),
    Parameter("restart_takes_s", 2.0, "from the restart to its outcome"),
)
_SPEAKERS = ("watchdog", "landing_detection", "autopilot", "mission_planner", "data_recorder")
_OVER = Parameter("over_s", 0.0, "how long it takes; 0: at once")

_KINDS: Tuple[FaultKind, ...] = (
    FaultKind(Subject.COMPONENT, "silent", "sends no samples; its process lives", _RESTART),
    FaultKind(
        Subject.COMPONENT,
        "killed",
        "its process ends, and with it its samples and those of all components of its node",
        _RESTART,
    ),
    FaultKind(
        Subject.COMPONENT,
        "slow",
        "sends its samples at a part of its rate",
        (Parameter("rate_fraction", None, "part of its rate that is left", high=1.0), *_RESTART),
    ),
    FaultKind(
        Subject.COMPONENT,
        "flapping",
        "is silent and sends again, over and over; it begins with silence",
        (
            Parameter("off_s", None, "how long it is silent", low=0.001),
            Parameter("on_s", None, "how long it sends", low=0.001),
            *_RESTART,
        ),
    ),
    FaultKind(Subject.COMPONENT, "nan", "its samples hold NaN instead of numbers", _RESTART),
    FaultKind(Subject.COMPONENT, "stuck", "its samples repeat the value of the moment at which it stuck", _RESTART),
    FaultKind(
        Subject.COMPONENT,
        "reads",
        "a range sensor that reads this value whatever is below it",
        (Parameter("value_m", None, "what it reads", low=-100.0, high=100.0), *_RESTART),
    ),
    FaultKind(Subject.COMPONENT, "unhealthy", "a sensor of the PX4 that the autopilot says is not healthy"),
    FaultKind(Subject.COMPONENT, "unreported", "a sensor of the PX4 of which the autopilot says nothing"),
    FaultKind(Subject.PROCESS, "killed", "the process ends: no status, no services"),
    FaultKind(Subject.PROCESS, "silent", "its status stops; its services answer", targets=_SPEAKERS),
    FaultKind(Subject.PROCESS, "stuck", "its messages go on, its working loop does not", targets=("watchdog",)),
    FaultKind(
        Subject.PROCESS,
        "slow",
        "its status comes at a part of its rate",
        (Parameter("rate_fraction", None, "part of its rate that is left", low=0.001, high=1.0),),
        _SPEAKERS,
    ),
    FaultKind(Subject.PROCESS, "goes_on", "goes on by itself when it should hold", targets=("mission_planner",)),
    FaultKind(Subject.PROCESS, "fails", "says that it has failed, and goes on", targets=("mission_planner",)),
    FaultKind(
        Subject.PROCESS,
        "restarted",
        "the engine's process dies and is started again when the fault ends; in virtual time only",
        (Parameter("journal", "kept", "what the new process finds of the old one", choices=("kept", "lost")),),
        (ENGINE,),
    ),
    FaultKind(
        Subject.PROCESS, "interrupted", "the engine's process is told to end; in virtual time only", (), (ENGINE,)
    ),
    FaultKind(Subject.SERVICE, "refuses", "answers no"),
    FaultKind(Subject.SERVICE, "hangs", "does not answer, and does nothing"),
    FaultKind(Subject.SERVICE, "vanishes", "is not there"),
    FaultKind(Subject.SERVICE, "breaks", "dies in mid-call, having done nothing"),
    FaultKind(
        Subject.SERVICE,
        "slow",
        "does what it is asked, and answers late",
        (Parameter("delay_s", None, "how late"),),
    ),
    FaultKind(Subject.SERVICE, "lies", "answers yes, and does nothing"),
    FaultKind(
        Subject.WORLD,
        "battery_drops",
        "the battery loses charge",
        (Parameter("to_fraction", None, "the level it goes down to", high=1.0), _OVER),
    ),
    FaultKind(Subject.WORLD, "battery_unknown", "the autopilot does not know its battery"),
    FaultKind(
        Subject.WORLD,
        "pilot_takes_over",
        "the pilot flies: he stays where he is, lands and disarms; when the fault ends he gives the vehicle back",
        (
            Parameter(
                "mode", "POSCTL", "the mode he flies in", choices=("POSCTL", "ALTCTL", "STABILIZED", "AUTO.LOITER")
            ),
            Parameter("land_after_s", 5.0, "how long he stays in the air"),
        ),
    ),
    FaultKind(Subject.WORLD, "pilot_arms", "somebody arms the vehicle on the ground"),
    FaultKind(Subject.WORLD, "pilot_disarms", "somebody disarms the vehicle; on the ground only"),
    FaultKind(
        Subject.WORLD,
        "land_switch",
        "the pilot throws the transmitter's switch that means land (`land_switch` of autopilot.yaml) while it lasts",
    ),
    FaultKind(
        Subject.WORLD,
        "estimate_off",
        "the autopilot is wrong about where the vehicle is",
        (
            Parameter("height_m", 0.0, "added to the height", low=-1000.0, high=1000.0),
            Parameter("position_m", 0.0, "added to the position, along x", low=-10_000.0, high=10_000.0),
        ),
    ),
    FaultKind(
        Subject.WORLD,
        "not_initialised",
        "the estimator does not begin when it is told to (`initialisation` of sensors.yaml)",
        (
            Parameter(
                "how", "refuses", "what its service does; lies: it says yes", choices=("refuses", "hangs", "lies")
            ),
        ),
    ),
    FaultKind(Subject.WORLD, "seems_landed", "the autopilot says in flight that it is on the ground"),
    FaultKind(Subject.WORLD, "ground_unknown", "the autopilot does not know whether it is on the ground"),
    FaultKind(
        Subject.WORLD,
        "autopilot_failsafe",
        "the autopilot acts by a failsafe of its own",
        (Parameter("mode", "AUTO.RTL", "the mode it enters", choices=("AUTO.RTL", "AUTO.LAND", "AUTO.LOITER")),),
    ),
    FaultKind(
        Subject.WORLD,
        "gps_lost",
        "the GPS has no fix: five seconds later the autopilot gives its position up and lands by a failsafe of its own",
    ),
    FaultKind(
        Subject.WORLD,
        "autopilot_link_lost",
        "the autopilot node hears nothing of the vehicle: its status goes on with what it knew",
    ),
    FaultKind(
        Subject.WORLD,
        "not_ready",
        "the autopilot's check of itself fails, and it will not arm",
        (Parameter("what", None, "what is wrong", choices=("prearm", "rc", "kill_switch", "home", "parameters")),),
    ),
    FaultKind(
        Subject.WORLD,
        "tilted",
        "the vehicle stands on a slope",
        (Parameter("tilt_deg", None, "angle to the vertical", high=180.0),),
    ),
    FaultKind(
        Subject.WORLD,
        "tilted_in_flight",
        "the vehicle leans in the air, wherever it flies",
        (Parameter("tilt_deg", None, "angle to the vertical", high=85.0),),
    ),
    FaultKind(
        Subject.WORLD,
        "raised",
        "the vehicle stands on something that its range sensor looks past",
        (Parameter("height_m", None, "how high", high=10.0),),
    ),
    FaultKind(Subject.WORLD, "does_not_arm", "the autopilot accepts the takeoff and does not arm"),
    FaultKind(Subject.WORLD, "does_not_lift_off", "the motors turn and it stays on the ground"),
    FaultKind(
        Subject.WORLD,
        "does_not_climb",
        "it does not get higher than this",
        (Parameter("above_m", None, "where it ends", low=0.05),),
    ),
    FaultKind(
        Subject.WORLD,
        "ignores_mode",
        "the autopilot does not enter a mode, though it acknowledges the command",
        (Parameter("mode", None, "which", choices=("AUTO.LOITER", "AUTO.MISSION", "AUTO.LAND")),),
    ),
    FaultKind(Subject.WORLD, "does_not_descend", "it stands in the air in the mode of landing"),
    FaultKind(Subject.WORLD, "does_not_disarm", "the motors keep turning after the landing"),
    FaultKind(
        Subject.WORLD,
        "data_incomplete",
        "verifying the recording finds that a platform's part is missing; while it is so, every retry ends the same",
        (Parameter("platform", "", "whose; empty: the last one's"),),
    ),
    FaultKind(
        Subject.WORLD,
        "recording_does_not_grow",
        "the files of a platform do not grow",
        (Parameter("platform", "", "whose; empty: the last one's"),),
    ),
    FaultKind(
        Subject.WORLD,
        "recording_fails",
        "a platform's recorder ends by itself while it records",
        (Parameter("platform", "", "whose; empty: the last one's"),),
    ),
)

KINDS: Mapping[Tuple[str, str], FaultKind] = {(kind.subject, kind.name): kind for kind in _KINDS}

EVENTS: Mapping[str, str] = {
    "armed": "the vehicle is armed",
    "takeoff": "the vehicle is armed and about to lift off, by command",
    "airborne": "the vehicle leaves the ground",
    "mission": "it begins, or goes on, to follow its waypoints",
    "waypoint": "it reaches a waypoint; `number` says which, from 1",
    "hold": "it begins to hold its position",
    "land": "it begins to land",
    "landed": "it stands on the ground after a flight",
    "disarmed": "the motors stop",
    "pilot": "the pilot takes over",
    "watched": "the watchdog begins to watch",
    "recording": "the recorder's files grow",
    "loaded": "the planner has the waypoints",
    "merging": "the recordings are being merged",
    "complete": "the recording is complete",
}


@dataclass(frozen=True)
class Trigger:
    """When something begins: at a time since the start of the world, or a time after an event or a state.

    Args:
        at_ns: since the start of the world; None: it waits for `event` or `state`.
        event: a name from EVENTS.
        state: a state of the engine, e.g. "OUTREACH".
        number: of the waypoint, for the event "waypoint"; 0: any.
        occurrence: which time it happens, from 1.
        delay_ns: after that.
    """

    at_ns: Optional[int] = None
    event: str = ""
    state: str = ""
    number: int = 0
    occurrence: int = 1
    delay_ns: int = 0


@dataclass(frozen=True)
class Fault:
    """One fault of a scenario.

    Args:
        kind: what it does.
        target: name of the component, process or service; empty when there is only one.
        trigger: when it begins.
        for_ns: how long it lasts; None: until a restart ends it, or for ever.
        parameters: what is said of it beyond that.
        where: file and line it was read from.
    """

    kind: FaultKind
    target: str
    trigger: Trigger
    for_ns: Optional[int] = None
    parameters: Tuple[Tuple[str, _Value], ...] = ()
    where: str = field(default="", compare=False)

    def _value(self, name: str) -> _Value:
        given: Dict[str, _Value] = dict(self.parameters)
        for parameter in self.kind.parameters:
            if parameter.name == name:
                value = given.get(name, parameter.default)
                if value is None:
                    break
                return value
        raise KeyError(f"{self.kind.name} has no {name}")

    def number(self, name: str) -> float:
        """Return a number that was said of it, or its default."""
        return float(self._value(name))

    def word(self, name: str) -> str:
        """Return a word that was said of it, or its default."""
        return str(self._value(name))

    def has(self, name: str) -> bool:
        """Tell whether this kind of fault has such a parameter."""
        return any(parameter.name == name for parameter in self.kind.parameters)

    def __str__(self) -> str:
        return f"{self.target} {self.kind.name}".strip()


@dataclass(frozen=True)
class Request:
    """What a user asks, and when; `command` None: to fly `missions`, by their ids."""

    command: Optional[UserCommand]
    trigger: Trigger
    missions: Tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"select {', '.join(self.missions)}" if self.command is None else self.command.value


@dataclass(frozen=True)
class Scenario:
    """A story for the world: what goes wrong, and what the user does.

    Args:
        description: one line.
        faults: in the order of the file.
        requests: in the order of the file.
    """

    description: str = "nothing goes wrong"
    faults: Tuple[Fault, ...] = ()
    requests: Tuple[Request, ...] = ()
