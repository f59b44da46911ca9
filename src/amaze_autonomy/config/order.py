"""Which limit of autonomy.yaml must not be above which other: a table, and the check of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Mapping, NoReturn, Tuple

from .binding import refuse_at
from .kinds import Places

__all__ = ["LOSS_RATES", "ORDER", "Order", "check_order"]


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


def _value(values: Mapping[str, Any], address: str) -> float:
    group, key = address.split(".")
    return float(values[group][key])


def check_order(values: Mapping[str, Any], places: Places) -> None:
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
            refuse_at(tuple(limit.split(".")), places, f"is {_value(values, limit):g}", right)


def _out_of_order(order: Order, low: float, high: float, places: Places) -> NoReturn:
    one, other = tuple(order.low.split(".")), tuple(order.high.split("."))
    if one not in places and other in places:
        word = "at least" if order.equal else "above"
        refuse_at(other, places, f"is {high:g}", f"must be {word} {order.low} ({low:g}): {order.reason}")
    word = "at most" if order.equal else "below"
    refuse_at(one, places, f"is {low:g}", f"must be {word} {order.high} ({high:g}): {order.reason}")
