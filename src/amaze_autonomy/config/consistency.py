"""What must be true between keys: tables of pairs, and the rules of the decision table.

A value alone is judged by its kind (`kinds.py`); here are the mistakes that need two values to be seen.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Any, Dict, Iterable, Mapping, NoReturn, Tuple

from amaze_autonomy.engine.severity import SEVERITIES, Severity, Verb

from .binding import place_of
from .errors import ConfigError
from .kinds import Address, Places, dotted

__all__ = [
    "LOSS_RATES",
    "ORDER",
    "Order",
    "check_autonomy",
    "check_components",
    "check_known",
    "check_recording",
    "waits",
]


@dataclass(frozen=True)
class Order:
    """One value must not be above another.

    Args:
        low: address of the one, dotted.
        high: address of the other.
        equal: they may be equal.
        reason: why.
    """

    low: str
    high: str
    equal: bool
    reason: str


ORDER: Tuple[Order, ...] = (
    Order("checks.preflight_fix_poll_s", "checks.preflight_fix_limit_s", False, "else the fix is never asked for"),
    Order("checks.check_reply_limit_s", "checks.check_max_age_s", False, "else a slow answer is too old when it comes"),
    Order("recording.recording_lead_s", "recording.recording_start_limit_s", False, "else no recording starts in time"),
    Order("takeoff.takeoff_height_m", "flight.max_height_m", False, "else every takeoff ends in a landing"),
    Order("landing.land_repeat_period_s", "landing.land_second_route_after_s", False, "LAND is repeated before"),
    Order("landing.descent_time_s", "landing.land_second_route_after_s", False, "else no descent is seen before"),
    Order("landing.land_second_route_after_s", "landing.land_alarm_after_s", True, "the pilot is the last route"),
    Order("landing.land_alarm_after_s", "landing.land_limit_s", False, "the pilot needs time to land it"),
    Order("landing.ground_disarm_after_s", "landing.land_limit_s", False, "else it is never disarmed in time"),
    Order("losses.clock_tolerance_s", "losses.status_max_age_s", False, "else the future passes for the present"),
    Order(
        "battery.battery_critical_fraction", "battery.battery_reserve_fraction", True, "else every mission ends by it"
    ),
    Order("commands.user_hold_limit_s", "flight.max_flight_time_s", False, "else a hold outlasts the flight"),
)

# limit of a loss, rate of the messages whose absence it is
LOSS_RATES: Tuple[Tuple[str, str], ...] = (
    ("losses.watchdog_heartbeat_limit_s", "streams.watchdog_action_rate_hz"),
    ("losses.planner_status_limit_s", "streams.planner_status_rate_hz"),
    ("losses.autopilot_status_limit_s", "streams.autopilot_status_rate_hz"),
    ("losses.status_max_age_s", "streams.autopilot_status_rate_hz"),
    ("losses.landing_detection_limit_s", "streams.landing_detection_rate_hz"),
    ("losses.recorder_status_limit_s", "streams.recorder_status_rate_hz"),
)
_PERIODS = 2


def _refuse(address: Address, places: Places, wrong: str, right: str) -> NoReturn:
    raise ConfigError(place_of(address, places), dotted(address), wrong, right)


def _value(values: Mapping[str, Any], address: str) -> float:
    group, key = address.split(".")
    return float(values[group][key])


def check_autonomy(values: Mapping[str, Any], places: Places) -> None:
    """Check the limits of the engine against each other.

    Raises:
        ConfigError: about the key of the pair that the file gives; about the lower one when it gives both.
    """
    for order in ORDER:
        low, high = _value(values, order.low), _value(values, order.high)
        if low > high or (low == high and not order.equal):
            _out_of_order(order, low, high, places)
    for limit, rate in LOSS_RATES:
        least = _PERIODS / _value(values, rate)
        if _value(values, limit) < least:
            right = f"must be at least {least:g}, {_PERIODS} periods of {rate}: one lost message is no loss"
            _refuse(tuple(limit.split(".")), places, f"is {_value(values, limit):g}", right)


def _out_of_order(order: Order, low: float, high: float, places: Places) -> NoReturn:
    one, other = tuple(order.low.split(".")), tuple(order.high.split("."))
    if one not in places and other in places:
        word = "at least" if order.equal else "above"
        _refuse(other, places, f"is {high:g}", f"must be {word} {order.low} ({low:g}): {order.reason}")
    word = "at most" if order.equal else "below"
    _refuse(one, places, f"is {low:g}", f"must be {word} {order.high} ({high:g}): {order.reason}")


def waits(severity: str) -> bool:
    """Return whether a flight waits for a component of this severity."""
    return SEVERITIES[Severity(severity)].verb is Verb.WAIT


def check_components(components: Mapping[str, Any], places: Places) -> None:
    """Check each row of the decision table.

    Raises:
        ConfigError: about the first key that cannot be.
    """
    for name, component in components.items():
        here = ("components", name)
        _check_sources(component, here, places)
        _check_restart(component, here, places)
        _check_wait(component, here, places)
        for topic, values in component["topics"].items():
            _check_topic(values, (*here, "topics", topic), places)


def _check_sources(component: Mapping[str, Any], here: Address, places: Places) -> None:
    if not (component["topics"] or component["node"] or component["driver"] or component["autopilot"]):
        right = "must have a source: topics, node, driver or autopilot; nothing would be watched"
        _refuse(here, places, "has no source", right)
    if component["autopilot"] and component["group"] != "px4":
        right = f"must be px4: the autopilot says how its {component['autopilot']} is"
        _refuse((*here, "group"), places, f"is {component['group']}", right)


def _check_restart(component: Mapping[str, Any], here: Address, places: Places) -> None:
    restart, at = component["restart"], (*here, "restart")
    policy = restart["policy"]
    if component["group"] == "px4" and policy != "never":
        right = "must be never in group px4: the vehicle would be uncontrollable"
        _refuse((*at, "policy"), places, f"is {policy}", right)
    if policy == "node" and not component["node"]:
        _refuse(
            (*at, "policy"), places, "is node", "must be another one, or node must be given: there is none to restart"
        )
    if policy in ("driver", "command") and not restart["command"]:
        right = f"must be given with the policy {policy}: program and arguments"
        _refuse((*at, "command"), places, "is missing", right)
    if policy in ("never", "node") and restart["command"]:
        right = "must be left out, or the policy must be driver or command"
        _refuse((*at, "command"), places, f"is given with the policy {policy}", right)
    if restart["total_limit_s"] < restart["attempt_limit_s"]:
        right = f"must be at least attempt_limit_s ({restart['attempt_limit_s']:g})"
        _refuse((*at, "total_limit_s"), places, f"is {restart['total_limit_s']:g}", right)


def _check_wait(component: Mapping[str, Any], here: Address, places: Places) -> None:
    at, wait, severity = (*here, "wait_limit_s"), component["wait_limit_s"], component["severity"]
    if waits(severity) and wait is None:
        right = f"must be given: with severity {severity} a flight waits, and every wait has a limit"
        _refuse(at, places, "is missing", right)
    if not waits(severity) and wait is not None:
        what = "flown on without" if SEVERITIES[Severity(severity)].verb is Verb.CONTINUE else "landed for at once"
        right = f"must be left out: with severity {severity} it is {what}, nobody waits"
        _refuse(at, places, f"is {wait:g}", right)
    restart = component["restart"]
    if wait is not None and restart["policy"] != "never" and wait < restart["attempt_limit_s"]:
        right = (
            f"must be at least restart.attempt_limit_s ({restart['attempt_limit_s']:g}): no restart would end in time"
        )
        _refuse(at, places, f"is {wait:g}", right)


def _check_topic(values: Mapping[str, Any], here: Address, places: Places) -> None:
    period = 1.0 / values["rate_hz"]
    if values["age_limit_s"] < 3 * period - 1e-9:
        right = f"must be at least {3 * period:.6g}, three periods of rate_hz: one or two lost messages are no failure"
        _refuse((*here, "age_limit_s"), places, f"is {values['age_limit_s']:g}", right)
    if values["window_s"] is not None and values["window_s"] < 4 * period - 1e-9:
        right = f"must be at least {4 * period:.6g}, four periods of rate_hz"
        _refuse((*here, "window_s"), places, f"is {values['window_s']:g}", right)
    most = 1.0 - values["tolerance_fraction"]
    if not values["rate_failed_fraction"] < most:
        right = f"must be below 1 - tolerance_fraction ({most:g}): a slow topic comes before a failed one"
        _refuse((*here, "rate_failed_fraction"), places, f"is {values['rate_failed_fraction']:g}", right)


def check_known(names: Iterable[str], known: Iterable[str], what: str, here: Address, places: Places) -> None:
    """Check that every name is known; `here` is the address of the list, or of the group whose keys they are.

    Raises:
        ConfigError: with the name that was probably meant.
    """
    there = list(known)
    for position, name in enumerate(names):
        if name not in there:
            at = next((each for each in ((*here, str(position)), (*here, name)) if each in places), here)
            close = difflib.get_close_matches(name, there, n=1)
            right = f"did you mean {close[0]}?" if close else f"known: {', '.join(there)}"
            _refuse(at, places, f"{name} is not a {what}", right)


def check_recording(values: Mapping[str, Any], places: Places) -> None:
    """Check that platforms record groups that exist, and every topic once.

    Raises:
        ConfigError: about the first key that cannot be.
    """
    check_known([values["collector"]], values["platforms"], "platform", ("collector",), places)
    recorded: Dict[str, str] = {}
    for platform, content in values["platforms"].items():
        here = ("platforms", platform, "groups")
        check_known(content["groups"], values["groups"], "group", here, places)
        for group in content["groups"]:
            for position, topic in enumerate(values["groups"][group]["topics"]):
                if topic in recorded:
                    at = ("groups", group, "topics", str(position))
                    wrong = f"{topic} is recorded by {recorded[topic]} and by {platform} in {group}"
                    _refuse(at, places, wrong, "must be recorded once: the merged recording would have it twice")
                recorded[topic] = f"{platform} in {group}"
    for group in values["groups"]:
        if not any(group in content["groups"] for content in values["platforms"].values()):
            _refuse(("groups", group), places, "is recorded by no platform", "must be in the groups of one")
