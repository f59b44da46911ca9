"""The simulated nodes that speak to the vehicle: the autopilot node, and the mission planner and sequencer."""

from __future__ import annotations

import random
from math import degrees, sqrt
from typing import Dict, List, Optional, Tuple

from amaze_autonomy.engine.commands import (
    AutopilotDisarm,
    AutopilotLand,
    LoadMission,
    MissionAction,
    MissionCommand,
    Request,
    RunCheck,
)
from amaze_autonomy.engine.events import AutopilotStatus, Event, MissionPhase, MissionStatus, VehicleLanded
from amaze_autonomy.engine.state import evolve
from amaze_autonomy.missions import Waypoint, distance_m, leg_s
from amaze_autonomy.monitoring.battery import BatteryMonitor
from amaze_autonomy.monitoring.gravity import LastingTilt
from amaze_autonomy.monitoring.land_switch import LandSwitchMonitor

from ...engine.events import CHECKS, Check, Verdict
from ..scenario import Subject
from ..vehicle.flight import TRANSMITTER_LOSS_NS
from ..vehicle.vehicle import LANDING_MODES, Mode, Vehicle
from .peer import Cadence, Peer, Site, accepted, refused, slowness

# --- the autopilot node -----------------------------------------------------------------------------------------------


_S = 1_000_000_000
_NOISE_M = 0.02
_LINK_LIMIT_S = 2.0
_REPORT_NS = _S // 2  # between two SYS_STATUS
_SWITCH_US = {False: 1000.0, True: 2000.0}

SENSORS = ("gps", "imu", "magnetometer", "barometer")

_FIXES = {True: "3D", False: "no fix", None: ""}
_SATELLITES = {True: 12.0, False: 0.0, None: None}

_READY: Tuple[Tuple[str, str, str], ...] = (
    ("prearm", "pre-arm check", "read the autopilot's messages and put right what it names"),
    ("rc", "RC receiver", "switch on the transmitter"),
    ("kill_switch", "kill switch", "release the kill switch"),
    ("home", "home position", "wait for the home position"),
    ("parameters", "parameters", "load the parameters of this vehicle"),
)


class Autopilot(Peer):
    """Hears the vehicle over its link; a link that is lost leaves what was heard last, getting older."""

    name = "autopilot"

    def __init__(self, site: Site) -> None:
        super().__init__(site)
        self._noise: random.Random = site.noise(self.name)
        self._cadence = Cadence(site.settings.rates.autopilot_status_rate_hz)
        self._heard: Optional[AutopilotStatus] = None
        self._monitor = BatteryMonitor(site.settings.battery)
        self._battery_ns: Optional[int] = None
        self._tilt = LastingTilt(round(_LINK_LIMIT_S * _S))
        self._switch = LandSwitchMonitor(site.settings.land_switch)
        self._transmitter_ns: Optional[int] = None

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Check, land or disarm."""
        if not isinstance(command, (AutopilotLand, AutopilotDisarm)):
            return super().answer(t_ns, command)
        if self.site.world_fault("autopilot_link_lost") is not None:
            return refused(command, "no link to the vehicle")
        vehicle = self.site.vehicle
        problem = vehicle.land() if isinstance(command, AutopilotLand) else vehicle.disarm()
        return refused(command, problem) if problem else accepted(command)

    def checks(self, t_ns: int, command: RunCheck) -> Tuple[Check, ...]:
        """Tell what a takeoff needs of it, or of its battery."""
        if "required_fraction" in CHECKS[command.check].asks:
            return self._monitor.check(t_ns, command.required_fraction).checks
        return self._check(t_ns)

    def land_switch(self, t_ns: int) -> Optional[bool]:
        """Return whether the switch of the transmitter says land; None: its channel is not heard."""
        return self._switch.on(t_ns)

    def step(self, t_ns: int) -> List[Event]:
        """Listen, and tell."""
        if self.site.world_fault("autopilot_link_lost") is None or self._heard is None:
            self._listen(t_ns)
        heard = self._heard
        if heard is None:
            return []
        health = sensor_health(self.site)
        key = (heard.armed, heard.landed, heard.mode, heard.pilot_in_control, heard.failsafe, tuple(health.items()))
        if not self._cadence.due(t_ns, key, slowness(self.site, self.name)):
            return []
        if heard.t_ns == t_ns:
            self.site.health = (t_ns, health)
        battery_ns = self._battery_ns
        return [
            evolve(
                heard,
                t_ns=t_ns,
                link_age_s=round((t_ns - heard.t_ns) / _S, 3),
                battery_age_s=None if battery_ns is None else round((t_ns - battery_ns) / _S, 3),
                gps_fix=_FIXES[health.get("gps")],
                satellites=_SATELLITES[health.get("gps")],
            )
        ]

    def _listen_to_switch(self, t_ns: int, *, lost: bool) -> None:
        """Take its channel, which the receiver makes up of a transmitter that is lost."""
        self._transmitter_ns = self._transmitter_ns if lost else t_ns
        heard = self._transmitter_ns is not None and t_ns - self._transmitter_ns < TRANSMITTER_LOSS_NS
        width_us = _SWITCH_US[lost or self.site.vehicle.flags.land_switch] if heard else None
        self._switch.add(t_ns, width_us, t_ns // _REPORT_NS)

    def _listen(self, t_ns: int) -> None:
        """Take over what the vehicle says now."""
        vehicle, power = self.site.vehicle, self.site.power
        voltage = power.voltage_v(flying=vehicle.airborne)
        fraction = None
        if voltage is not None:
            fraction, voltage = round(power.fraction, 4), round(voltage, 3)
            self._battery_ns = t_ns
        self._monitor.add(t_ns, fraction, voltage)
        if self._switch.spec.channel:
            self._listen_to_switch(t_ns, lost="rc" in vehicle.flags.not_ready)
        self._tilt.add(t_ns, vehicle.tilt_rad)
        tilt_rad = self._tilt.tilt_rad(t_ns)
        off = self.site.world_fault("estimate_off")
        up_m, away_m = (off.number("height_m"), off.number("position_m")) if off is not None else (0.0, 0.0)
        self._heard = AutopilotStatus(
            t_ns=t_ns,
            armed=vehicle.armed,
            landed=self._landed(),
            mode=vehicle.mode,
            pilot_in_control=vehicle.pilot,
            failsafe=vehicle.failsafe,
            height_m=self._noisy(vehicle.position_m[2] + up_m),
            position_x_m=self._noisy(vehicle.position_m[0] + away_m),
            position_y_m=self._noisy(vehicle.position_m[1]),
            vertical_speed_m_s=round(vehicle.velocity_m_s[2], 3),
            horizontal_speed_m_s=round(sqrt(vehicle.velocity_m_s[0] ** 2 + vehicle.velocity_m_s[1] ** 2), 3),
            battery_fraction=fraction,
            battery_voltage_v=voltage,
            tilt_deg=None if tilt_rad is None else round(degrees(tilt_rad), 0),
        )

    def _landed(self) -> VehicleLanded:
        if self.site.world_fault("ground_unknown"):
            return VehicleLanded.UNKNOWN
        return VehicleLanded.ON_GROUND if self.site.world_fault("seems_landed") else self.site.vehicle.landed

    def _noisy(self, value: float) -> float:
        return round(value + _NOISE_M * self._noise.uniform(-1.0, 1.0), 3)

    def _check(self, t_ns: int) -> Tuple[Check, ...]:
        heard, problems = self._heard, self.site.vehicle.flags.not_ready
        age = None if heard is None else (t_ns - heard.t_ns) / _S
        fresh = age is not None and age <= _LINK_LIMIT_S
        advice = "" if fresh else "check the link to the autopilot"
        link = Verdict.PASS if fresh else Verdict.FAIL
        rows = [Check("autopilot link", link, age, _LINK_LIMIT_S, "s", age, advice)]
        armed = heard.armed if heard is not None and fresh else None
        rows.append(_row("not armed", None if armed is None else not armed, age, "disarm the vehicle"))
        for key, name, words in _READY:
            rows.append(_row(name, key not in problems if fresh else None, age, words))
        if self._switch.spec.channel:
            on = self.land_switch(t_ns)
            row = _row("land switch", None if on is None else not on, age, "switch it back: it says land")
            rows.append(evolve(row, heals=not row.passed))
        return tuple(rows)


def sensor_health(site: Site) -> Dict[str, bool]:
    """Return sensor -> healthy, as the vehicle reports it; a sensor that it does not report is not there."""
    health: Dict[str, bool] = {}
    for component in site.settings.components:
        if component.autopilot is None:
            continue
        kinds = [fault.kind.name for fault, _ in site.faults.on(Subject.COMPONENT, component.name)]
        if "unreported" not in kinds:
            health[component.autopilot.value] = not any(kind in _UNHEALTHY for kind in kinds)
    if site.vehicle.flags.gps_lost and "gps" in health:
        health["gps"] = False
    return health


_UNHEALTHY = ("unhealthy", "silent", "killed", "nan", "stuck")


def _row(name: str, good: Optional[bool], age_s: Optional[float], advice: str) -> Check:  # noqa: FBT001
    if good is None:
        return Check(name, Verdict.UNKNOWN, age_s=age_s, advice="check the link to the autopilot")
    return Check(name, Verdict.PASS if good else Verdict.FAIL, age_s=age_s, advice="" if good else advice)


# --- the mission planner and sequencer --------------------------------------------------------------------------------


_IN_FLIGHT = (MissionPhase.TAKING_OFF, MissionPhase.FLYING, MissionPhase.HOLDING, MissionPhase.LANDING)


class Planner(Peer):
    """Reads its phase from the vehicle: what was commanded is done when the vehicle shows it."""

    name = "mission_planner"

    def __init__(self, site: Site) -> None:
        super().__init__(site)
        self._phase = MissionPhase.IDLE
        self._session = self._mission = self._message = ""
        self._file = self._repetition = 0
        self._was_armed = self._lands = False
        self._cadence = Cadence(site.settings.rates.planner_status_rate_hz)

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Load a waypoint file, or carry out a command."""
        if isinstance(command, LoadMission):
            problem = self._load(command)
        elif isinstance(command, MissionCommand):
            problem = self._command(command)
        else:
            return super().answer(t_ns, command)
        return refused(command, problem) if problem else accepted(command)

    def step(self, t_ns: int) -> List[Event]:
        """Follow the vehicle, land at the end of the sequence, and tell."""
        self._go_on(self.site.vehicle)
        self._follow(self.site.vehicle)
        vehicle = self.site.vehicle
        key = (self._phase, self._session, self._file, self._repetition, vehicle.reached, self._message)
        return [self._status(t_ns)] if self._cadence.due(t_ns, key, slowness(self.site, self.name)) else []

    def _load(self, command: LoadMission) -> str:
        vehicle = self.site.vehicle
        files = self.site.settings.trajectories.get(command.mission_id)
        if files is None:
            return f"there is no mission {command.mission_id!r}"
        if not 0 <= command.file_index < len(files):
            return f"mission {command.mission_id} has {len(files)} waypoint files, there is no {command.file_index + 1}"
        x, y, _ = vehicle.position_m
        problem = vehicle.upload(files[command.file_index].from_start(vehicle.yaw_rad, x, y).waypoints)
        if problem:
            return problem
        self._session, self._mission = command.session_id, command.mission_id
        self._file, self._repetition = command.file_index, command.repetition
        self._phase, self._message, self._was_armed, self._lands = MissionPhase.LOADED, "", False, False
        self.site.note("loaded")
        return ""

    def _command(self, command: MissionCommand) -> str:
        if command.action == MissionAction.LAND:
            return self._land()
        if command.action == MissionAction.ABORT:
            return self._abort()
        if command.session_id != self._session or not self._session:
            return f"session {command.session_id!r} is not the one that is loaded"
        if command.action == MissionAction.TAKEOFF:
            return self._take_off()
        return self._hold() if command.action == MissionAction.HOLD else self._resume()

    def _take_off(self) -> str:
        if self._phase != MissionPhase.LOADED:
            return f"there is nothing to fly in phase {self._phase.name}"
        problem = self.site.vehicle.take_off()
        if not problem:
            self._phase = MissionPhase.TAKING_OFF
        return problem

    def _hold(self) -> str:
        if self._phase not in (MissionPhase.TAKING_OFF, MissionPhase.FLYING, MissionPhase.HOLDING):
            return f"there is nothing to hold in phase {self._phase.name}"
        return self.site.vehicle.hold()

    def _resume(self) -> str:
        if self._phase not in (MissionPhase.TAKING_OFF, MissionPhase.FLYING, MissionPhase.HOLDING):
            return f"there is nothing to resume in phase {self._phase.name}"
        return self.site.vehicle.resume()

    def _land(self) -> str:
        problem, self._lands = self.site.vehicle.land(), True
        if not problem and not self.site.vehicle.armed and self._phase in _IN_FLIGHT:
            self._phase = MissionPhase.LANDED  # the takeoff was cancelled before it armed
        return problem

    def _abort(self) -> str:
        vehicle = self.site.vehicle
        if vehicle.airborne:
            self._lands = True
            return vehicle.land()
        problem = vehicle.disarm()
        if not problem and self._phase in _IN_FLIGHT:
            self._phase = MissionPhase.LANDED
        return problem

    def _go_on(self, vehicle: Vehicle) -> None:
        """Go on by itself while a fault says so."""
        if self._phase is MissionPhase.HOLDING and self.site.faults.active(Subject.PROCESS, "goes_on", self.name):
            vehicle.resume()

    def _follow(self, vehicle: Vehicle) -> None:
        """Read the phase from the vehicle."""
        if self._phase not in _IN_FLIGHT:
            return
        self._was_armed = self._was_armed or vehicle.armed
        if vehicle.finished and vehicle.mode == Mode.MISSION and not vehicle.pilot:
            vehicle.land()
            self._lands = True
        if self._is_over(vehicle):
            self._phase = MissionPhase.LANDED
        elif not self._was_armed:
            return  # the mode is still that of the flight before
        elif vehicle.pilot:
            self._message = "the pilot has control"
        elif vehicle.mode in LANDING_MODES and (self._lands or not vehicle.failsafe):  # else a failsafe lands it
            self._phase = MissionPhase.LANDING
        elif vehicle.mode == Mode.LOITER and vehicle.armed:
            self._phase = MissionPhase.HOLDING
        elif vehicle.mode == Mode.MISSION and vehicle.airborne:
            self._phase = MissionPhase.FLYING
        elif vehicle.mode == Mode.TAKEOFF:
            self._phase = MissionPhase.TAKING_OFF

    def _is_over(self, vehicle: Vehicle) -> bool:
        return self._was_armed and not vehicle.armed and vehicle.landed == VehicleLanded.ON_GROUND

    def _waypoint(self, waypoints: int) -> int:
        """Return the waypoint it flies to, from 1; from the landing on the last one that was reached."""
        if self._phase in (MissionPhase.LANDING, MissionPhase.LANDED):
            return self.site.vehicle.reached
        return min(self.site.vehicle.reached + 1, waypoints) if self._phase in _IN_FLIGHT else 0

    def _status(self, t_ns: int) -> MissionStatus:
        vehicle = self.site.vehicle
        waypoints = len(vehicle.waypoints) if self._session else 0
        distance, seconds = _left(vehicle) if self._session else (None, None)
        failed = self.site.faults.active(Subject.PROCESS, "fails", self.name) is not None
        return MissionStatus(
            t_ns=t_ns,
            session_id=self._session,
            mission_id=self._mission,
            phase=MissionPhase.FAILED if failed else self._phase,
            waypoint=self._waypoint(waypoints),
            waypoints=waypoints,
            file_index=self._file,
            repetition=self._repetition,
            distance_left_m=distance,
            time_left_s=seconds,
            message="the mission cannot be flown any further" if failed else self._message,
        )


def _left(vehicle: Vehicle) -> Tuple[float, float]:
    """Return metres and seconds along the waypoints that are left."""
    here = Waypoint(*vehicle.position_m, vehicle.yaw_rad, 0.0)
    metres = seconds = 0.0
    for target in vehicle.waypoints[vehicle.reached :]:
        metres += distance_m(here, target)
        seconds += leg_s(here, target, vehicle.settings.model) + target.hold_s
        here = target
    return round(metres, 3), round(seconds, 3)
