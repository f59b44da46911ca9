"""What a fault does to the vehicle, its battery and its pilot when it begins and when it ends.

Faults of components, processes and services are looked up where they matter; these here change something at a moment.
"""

from __future__ import annotations

from math import inf, radians
from typing import Callable, Mapping

from .peers.peer import Site
from .scenario import Fault

_S = 1_000_000_000
_Effect = Callable[[Site, Fault], None]


def begin(site: Site, fault: Fault) -> None:
    """Let a fault act on the vehicle."""
    effect = _BEGIN.get(fault.kind.name)
    if effect is not None and not fault.kind.subject:
        effect(site, fault)


def end(site: Site, fault: Fault) -> None:
    """Undo what a fault did to the vehicle, where that can be undone."""
    effect = _END.get(fault.kind.name)
    if effect is not None and not fault.kind.subject:
        effect(site, fault)


def _battery_drops(site: Site, fault: Fault) -> None:
    level, over_s = fault.number("to_fraction"), fault.number("over_s")
    if over_s <= 0.0:
        site.power.drop_to(level)
    else:
        site.power.drain_to(level, over_s)


def _battery_holds(site: Site, _: Fault) -> None:
    site.power.stop_draining()


def _battery_unknown(site: Site, _: Fault) -> None:
    site.power.known = False


def _battery_known(site: Site, _: Fault) -> None:
    site.power.known = True


def _pilot_takes_over(site: Site, fault: Fault) -> None:
    site.vehicle.pilot_takes_over(fault.word("mode"), round(fault.number("land_after_s") * _S))


def _pilot_gives_back(site: Site, _: Fault) -> None:
    site.vehicle.pilot_gives_back()


def _pilot_arms(site: Site, _: Fault) -> None:
    site.vehicle.pilot_arms()


def _pilot_disarms(site: Site, _: Fault) -> None:
    site.vehicle.disarm()


def _failsafe(site: Site, fault: Fault) -> None:
    site.vehicle.enter_failsafe(fault.word("mode"))


def _failsafe_ends(site: Site, _: Fault) -> None:
    site.vehicle.leave_failsafe()


def _gps_lost(site: Site, _: Fault) -> None:
    site.vehicle.lose_gps()


def _gps_found(site: Site, _: Fault) -> None:
    site.vehicle.find_gps()


def _not_ready(site: Site, fault: Fault) -> None:
    site.vehicle.flags.not_ready[fault.word("what")] = fault.word("what").replace("_", " ")


def _ready(site: Site, fault: Fault) -> None:
    site.vehicle.flags.not_ready.pop(fault.word("what"), None)


def _tilted(site: Site, fault: Fault) -> None:
    site.vehicle.flags.tilt_rad = radians(fault.number("tilt_deg"))


def _level(site: Site, _: Fault) -> None:
    site.vehicle.flags.tilt_rad = 0.0


def _leans(site: Site, fault: Fault) -> None:
    site.vehicle.flags.lean_rad = radians(fault.number("tilt_deg"))


def _upright(site: Site, _: Fault) -> None:
    site.vehicle.flags.lean_rad = 0.0


def _raised(site: Site, fault: Fault) -> None:
    site.vehicle.flags.raised_m = fault.number("height_m")


def _lowered(site: Site, _: Fault) -> None:
    site.vehicle.flags.raised_m = 0.0


def _does_not_climb(site: Site, fault: Fault) -> None:
    site.vehicle.flags.stops_climbing_at_m = fault.number("above_m")


def _climbs(site: Site, _: Fault) -> None:
    site.vehicle.flags.stops_climbing_at_m = inf


def _ignores(site: Site, fault: Fault) -> None:
    site.vehicle.flags.ignores = (*site.vehicle.flags.ignores, fault.word("mode"))


def _obeys(site: Site, fault: Fault) -> None:
    site.vehicle.flags.ignores = tuple(mode for mode in site.vehicle.flags.ignores if mode != fault.word("mode"))


def _flag(name: str, value: bool) -> _Effect:  # noqa: FBT001
    def effect(site: Site, _: Fault) -> None:
        setattr(site.vehicle.flags, name, value)

    return effect


_BEGIN: Mapping[str, _Effect] = {
    "battery_drops": _battery_drops,
    "battery_unknown": _battery_unknown,
    "pilot_takes_over": _pilot_takes_over,
    "pilot_arms": _pilot_arms,
    "pilot_disarms": _pilot_disarms,
    "autopilot_failsafe": _failsafe,
    "gps_lost": _gps_lost,
    "land_switch": _flag("land_switch", value=True),
    "not_ready": _not_ready,
    "tilted": _tilted,
    "tilted_in_flight": _leans,
    "raised": _raised,
    "does_not_arm": _flag("does_not_arm", value=True),
    "does_not_lift_off": _flag("does_not_lift_off", value=True),
    "does_not_climb": _does_not_climb,
    "ignores_mode": _ignores,
    "does_not_disarm": _flag("does_not_disarm", value=True),
}
_END: Mapping[str, _Effect] = {
    "battery_drops": _battery_holds,
    "autopilot_failsafe": _failsafe_ends,
    "gps_lost": _gps_found,
    "battery_unknown": _battery_known,
    "pilot_takes_over": _pilot_gives_back,
    "land_switch": _flag("land_switch", value=False),
    "not_ready": _ready,
    "tilted": _level,
    "tilted_in_flight": _upright,
    "raised": _lowered,
    "does_not_arm": _flag("does_not_arm", value=False),
    "does_not_lift_off": _flag("does_not_lift_off", value=False),
    "does_not_climb": _climbs,
    "ignores_mode": _obeys,
    "does_not_disarm": _flag("does_not_disarm", value=False),
}
