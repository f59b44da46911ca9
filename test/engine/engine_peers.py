"""The peers of a story: a vehicle, a planner, a recorder and a watchdog that do what is asked of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Dict, Optional, Tuple

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.events import Mission
from amaze_autonomy.engine.rules import Code, ComponentRule, Limits, Rules, Severity

S = 1_000_000_000
CRUISE_M = 2.0

# The decision table as DESIGN.md section 4 ships it, written by hand; the limits of waiting are this folder's own.
COMPONENTS = (
    ComponentRule("gps", "px4", restart=False, severity=Severity.LOW, wait_limit_ns=0),
    ComponentRule("imu", "px4", restart=False, severity=Severity.HIGHEST, wait_limit_ns=0),
    ComponentRule("magnetometer", "px4", restart=False, severity=Severity.MODERATE, wait_limit_ns=6 * S),
    ComponentRule("barometer", "px4", restart=False, severity=Severity.MODERATE, wait_limit_ns=7 * S),
    ComponentRule("mission_camera", "other", restart=True, severity=Severity.HIGHEST, wait_limit_ns=0),
    ComponentRule("realsense_camera", "other", restart=True, severity=Severity.MODERATE, wait_limit_ns=8 * S),
    ComponentRule("realsense_imu", "other", restart=False, severity=Severity.LOW, wait_limit_ns=0),
    ComponentRule("lsm9ds1_imu", "other", restart=True, severity=Severity.MODERATE, wait_limit_ns=9 * S),
    ComponentRule("lrf", "other", restart=True, severity=Severity.HIGH, wait_limit_ns=5 * S),
)
SHIPPED = Rules(components=COMPONENTS, limits=Limits())
MISSION = Mission(id="1", description="a square", battery_needed_fraction=0.4)
CHECKS = tuple(check.value for check in ev.CheckName)
"""In the order in which they are asked; `test_preflight.py` says by hand which must be among them."""


@dataclass
class Vehicle:
    """Goes up and down at 1 m/s; `says` overrides what its status claims."""

    armed: Optional[bool] = False
    landed: ev.VehicleLanded = ev.VehicleLanded.ON_GROUND
    mode: str = "AUTO.LOITER"
    height: float = 0.0
    speed: float = 0.0
    battery: float = 0.9
    obeys: bool = True
    auto_disarm: bool = True
    says: Dict[str, Any] = field(default_factory=dict)

    def move(self, seconds: float) -> None:
        self.height += self.speed * seconds
        if self.speed > 0 and self.height >= CRUISE_M:
            self.height, self.speed, self.landed = CRUISE_M, 0.0, ev.VehicleLanded.IN_AIR
        if self.speed < 0 and self.height <= 0:
            self.height, self.speed, self.landed = 0.0, 0.0, ev.VehicleLanded.ON_GROUND
            if self.auto_disarm:
                self.armed = False

    def take_off(self) -> None:
        self.armed, self.speed, self.mode, self.landed = True, 1.0, "AUTO.TAKEOFF", ev.VehicleLanded.TAKING_OFF

    def land(self) -> None:
        if not self.obeys:
            return
        if self.height > 0:
            self.speed, self.mode, self.landed = -1.0, "AUTO.LAND", ev.VehicleLanded.LANDING
        else:
            self.armed, self.mode = False, "AUTO.LAND"

    def status(self, t_ns: int) -> ev.AutopilotStatus:
        said = {
            "armed": self.armed,
            "landed": self.landed,
            "mode": self.mode,
            "height_m": self.height,
            "position_x_m": 0.0,
            "position_y_m": 0.0,
            "vertical_speed_m_s": self.speed,
            "horizontal_speed_m_s": 0.0,
            "battery_fraction": self.battery,
            "battery_voltage_v": 15.8,
            "battery_age_s": 0.1,
            "tilt_deg": 2.0,
        }
        return ev.AutopilotStatus(t_ns=t_ns, **{**said, **self.says})


@dataclass
class Planner:
    """Flies three waypoints of two seconds each and lands."""

    session: str = ""
    mission: str = ""
    phase: ev.MissionPhase = ev.MissionPhase.IDLE
    file_index: int = 0
    repetition: int = 0
    waypoint: int = 0
    flown_ns: int = 0
    says: Dict[str, Any] = field(default_factory=dict)

    def move(self, passed_ns: int, vehicle: Vehicle) -> None:
        if self.phase is ev.MissionPhase.TAKING_OFF and vehicle.height >= CRUISE_M:
            self.phase, self.waypoint = ev.MissionPhase.FLYING, 1
            vehicle.mode = "AUTO.MISSION"
        elif self.phase is ev.MissionPhase.FLYING:
            self.flown_ns += passed_ns
            self.waypoint = min(3, 1 + self.flown_ns // (2 * S))
            if self.flown_ns >= 6 * S:
                self.phase = ev.MissionPhase.LANDING
                vehicle.land()
        elif self.phase is ev.MissionPhase.LANDING and vehicle.armed is False and vehicle.height <= 0:
            self.phase = ev.MissionPhase.LANDED

    def status(self, t_ns: int) -> ev.MissionStatus:
        said = {
            "session_id": self.session,
            "mission_id": self.mission,
            "phase": self.phase,
            "waypoint": self.waypoint,
            "waypoints": 3,
            "file_index": self.file_index,
            "repetition": self.repetition,
        }
        return ev.MissionStatus(t_ns=t_ns, **{**said, **self.says})


@dataclass
class Recorder:
    """Records on both platforms, and collects everything when it is stopped."""

    session: str = ""
    phase: ev.RecordingPhase = ev.RecordingPhase.IDLE
    growing: Tuple[bool, ...] = (True, True)
    fails: bool = False
    says: Dict[str, Any] = field(default_factory=dict)

    def status(self, t_ns: int) -> ev.RecordingStatus:
        recording = self.phase is ev.RecordingPhase.RECORDING
        platforms = tuple(
            ev.PlatformRecording(platform=f"module{number}", growing=grows and recording)
            for number, grows in enumerate(self.growing, 1)
        )
        said = {
            "session_id": self.session,
            "phase": self.phase,
            "platforms": platforms,
            "location": f"/data/{self.session}" if self.phase is ev.RecordingPhase.COMPLETE else "",
            "message": "module2: no space left" if self.phase is ev.RecordingPhase.FAILED else "",
        }
        return ev.RecordingStatus(t_ns=t_ns, **{**said, **self.says})


@dataclass
class Watchdog:
    """Watches nine components; says their codes."""

    sequence: int = 0
    loop: int = 0
    stuck: bool = False
    components: Dict[str, ev.ComponentStatus] = field(
        default_factory=lambda: {rule.name: ev.ComponentStatus(rule.name, Code.NOMINAL) for rule in COMPONENTS}
    )
    latest: str = ""

    def action(self, t_ns: int) -> ev.WatchdogAction:
        self.sequence += 1
        self.loop += 0 if self.stuck else 1
        listed = tuple(s for s in self.components.values() if s.code >= Code.INCONVENIENT)
        code = max((s.code for s in listed), default=Code.NOMINAL)
        return ev.WatchdogAction(
            t_ns=t_ns,
            sequence=self.sequence,
            loop_counter=self.loop,
            code=code,
            latest_component=self.latest,
            components=listed,
        )

    def info(self, t_ns: int) -> ev.WatchdogInfo:
        self.sequence += 1
        changed = (self.latest,) if self.latest else ()
        return ev.WatchdogInfo(
            t_ns=t_ns, sequence=self.sequence, changed=changed, components=tuple(self.components.values())
        )
