"""What the tests of the simulated world share: a small world, and somebody who sends it commands."""

from __future__ import annotations

from amaze_autonomy.engine.commands import (
    LoadMission,
    MissionAction,
    MissionCommand,
    RunCheck,
    StartRecording,
    StopRecording,
)
from amaze_autonomy.engine.events import AutopilotStatus, CheckName, MissionStatus, RecordingStatus
from amaze_autonomy.engine.rules import Severity
from amaze_autonomy.missions import Trajectory, Waypoint
from amaze_autonomy.monitoring.specs import AutopilotSensor, ComponentSpec, RestartPolicy, RestartSpec, TopicSpec
from amaze_autonomy.simulation import Settings, World, parse_scenario
from amaze_autonomy.simulation.vehicle.vehicle import PowerSettings

S = 1_000_000_000
SQUARE = (Waypoint(0.0, 0.0, 2.0, 0.0, 1.0), Waypoint(3.0, 0.0, 2.0, 0.0, 0.0), Waypoint(3.0, 3.0, 2.0, 0.0, 2.0))
RESTARTS = RestartSpec(RestartPolicy.NODE, attempts=2, backoff_ns=S, attempt_limit_ns=4 * S, total_limit_ns=12 * S)
COMPONENTS = (
    ComponentSpec("gps", "px4", Severity.LOW, autopilot=AutopilotSensor.GPS),
    ComponentSpec("camera", severity=Severity.HIGHEST, topics=(TopicSpec("/camera", 20.0, finite=True),)),
    ComponentSpec(
        "lrf", severity=Severity.HIGH, topics=(TopicSpec("/lrf/range", 20.0),), node="/lrf", restart=RESTARTS
    ),
)


def small_settings(**changes):
    """Return the settings of a world with three components, one mission and a battery of four cells."""
    given = {
        "components": COMPONENTS,
        "trajectories": {"1": (Trajectory("square.csv", SQUARE), Trajectory("short.csv", SQUARE[:1]))},
        "power": PowerSettings(cells=6),
        **changes,
    }
    return Settings(**given)


def scenario(faults="", requests=""):
    """Return a scenario of faults and requests as they would be written in a file."""
    text = "description: a test\n"
    for name, lines in (("faults", faults), ("requests", requests)):
        if lines:
            text += f"{name}:\n" + "".join(f"  - {{{line.strip()}}}\n" for line in lines.strip().splitlines())
    return parse_scenario(text)


class Driver:
    """A world, and the commands that an engine would send it."""

    def __init__(self, faults="", requests="", seed=1, settings=None, **more):
        self.world = World(settings or small_settings(), seed, scenario(faults, requests), **more)
        self.events = []
        self._number = 0

    def go_on(self, seconds):
        """Let time pass; return what happened."""
        events = self.world.advance(self.world.now_ns + round(seconds * S))
        self.events.extend(events)
        return events

    def until(self, condition, limit_s=120.0):
        """Let time pass until a condition of the world holds; the limit passes: fail."""
        end_ns = self.world.now_ns + round(limit_s * S)
        while not condition():
            assert self.world.now_ns < end_ns, "never happened"
            self.events.extend(self.world.advance(self.world.next_ns))

    def send(self, kind, limit_s=1.0, **fields):
        """Send a command; return its number."""
        self._number += 1
        self.world.handle(self.world.now_ns, kind(id=self._number, limit_ns=round(limit_s * S), **fields))
        return self._number

    def ask(self, kind, limit_s=1.0, wait_s=1.5, **fields):
        """Send a command; return the reply that comes within a time, or None."""
        number = self.send(kind, limit_s, **fields)
        events = self.go_on(wait_s)
        return next((event for event in events if getattr(event, "command_id", 0) == number), None)

    def check(self, name: CheckName, **fields):
        """Ask for a check; return the reply."""
        return self.ask(RunCheck, check=name, limit_s=20.0, wait_s=12.0, startup_time_ns=5 * S, **fields)

    def ask_state(self):
        """Ask for the check of the state; return the reply as soon as it is there."""
        return self.ask(RunCheck, check=CheckName.STATE_ESTIMATION, wait_s=0.02)

    def load(self, file_index=0, mission_id="1", session_id="a"):
        return self.ask(
            LoadMission, wait_s=0.1, session_id=session_id, mission_id=mission_id, file_index=file_index, repetition=0
        )

    def command(self, action: MissionAction, session_id="a"):
        return self.ask(MissionCommand, wait_s=0.1, session_id=session_id, action=action)

    def take_off(self):
        """Load, take off, and wait until it flies its mission."""
        self.load()
        self.command(MissionAction.TAKEOFF)
        self.until(lambda: self.vehicle.mode == "AUTO.MISSION")

    def record(self, session_id="a"):
        return self.ask(StartRecording, wait_s=0.1, session_id=session_id, mission_id="1")

    def stop_recording(self, session_id="a"):
        return self.ask(StopRecording, wait_s=0.1, session_id=session_id)

    @property
    def vehicle(self):
        return self.world.vehicle

    def last(self, kind):
        """Return the last event of a kind."""
        return next(event for event in reversed(self.events) if isinstance(event, kind))

    @property
    def planner(self) -> MissionStatus:
        return self.last(MissionStatus)

    @property
    def recorder(self) -> RecordingStatus:
        return self.last(RecordingStatus)

    @property
    def autopilot(self) -> AutopilotStatus:
        return self.last(AutopilotStatus)


def changes(events, kind, field):
    """Return the values of a field of all events of a kind, equal ones in a row once."""
    values = []
    for event in events:
        if isinstance(event, kind) and (not values or values[-1] != getattr(event, field)):
            values.append(getattr(event, field))
    return values
