"""The simulated autopilot node: what it hears of the vehicle, its checks, and the second route of a landing."""

from __future__ import annotations

import random
from math import degrees, sqrt
from typing import Dict, List, Optional, Tuple

from amaze_autonomy.engine.commands import AutopilotDisarm, AutopilotLand, Request, RunCheck
from amaze_autonomy.engine.events import AutopilotStatus, Event, VehicleLanded
from amaze_autonomy.engine.state import evolve
from amaze_autonomy.monitoring.battery import BatteryMonitor
from amaze_autonomy.monitoring.gravity import LastingTilt
from amaze_autonomy.monitoring.land_switch import LandSwitchMonitor

from ...engine.events import CHECKS, Check, Verdict
from ..scenario import Subject
from .peer import Cadence, Peer, Site, accepted, refused, slowness

__all__ = ["SENSORS", "Autopilot", "sensor_health"]

_S = 1_000_000_000
_NOISE_M = 0.02
_LINK_LIMIT_S = 2.0
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

    def _listen(self, t_ns: int) -> None:
        """Take over what the vehicle says now."""
        vehicle, power = self.site.vehicle, self.site.power
        voltage = power.voltage_v(flying=vehicle.airborne)
        fraction = None
        if voltage is not None:
            fraction, voltage = round(power.fraction, 4), round(voltage, 3)
            self._battery_ns = t_ns
        self._monitor.add(t_ns, fraction, voltage)
        if self._switch.spec.channel and "rc" not in vehicle.flags.not_ready:
            self._switch.add(t_ns, _SWITCH_US[vehicle.flags.land_switch])
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
