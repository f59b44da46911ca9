"""Limits of autonomy.yaml against each other."""

from __future__ import annotations

import pytest

from amaze_autonomy.config import load_configuration


@pytest.mark.parametrize(
    "text, message",
    [
        (
            "checks: {preflight_fix_poll_s: 60.0}",
            "checks.preflight_fix_poll_s: is 60; must be below checks.preflight_fix_limit_s (60): "
            "else the fix is never asked for",
        ),
        (
            "checks: {check_max_age_s: 3.0}",
            "checks.check_max_age_s: is 3; must be above checks.check_reply_limit_s (3): "
            "else a slow answer is too old when it comes",
        ),
        (
            "checks: {reply_limits_s: {battery: 10.0}}",
            "checks.reply_limits_s.battery: is 10; must be below checks.check_max_age_s (10): "
            "else a slow answer is too old when it comes",
        ),
        (
            "checks: {max_ages_s: {battery: 2.0}}",
            "checks.max_ages_s.battery: is 2; must be above checks.check_reply_limit_s (3): "
            "else a slow answer is too old when it comes",
        ),
        (
            "checks: {max_ages_s: {battery: 5.0}, reply_limits_s: {battery: 6.0}}",
            "checks.reply_limits_s.battery: is 6; must be below checks.max_ages_s.battery (5): "
            "else a slow answer is too old when it comes",
        ),
        (
            "recording: {recording_lead_s: 20.0}",
            "recording.recording_lead_s: is 20; must be below recording.recording_start_limit_s (15): "
            "else no recording starts in time",
        ),
        (
            "flight: {max_height_m: 1.0}",
            "flight.max_height_m: is 1; must be above takeoff.takeoff_height_m (1): "
            "else every takeoff ends in a landing",
        ),
        (
            "flight: {max_tilt_deg: 40.0}",
            "flight.max_tilt_deg: is 40; must be at least flight.tilt_warning_deg (45): "
            "else it lands without a warning before",
        ),
        (
            "flight: {tilt_warning_deg: 5.0}",
            "flight.tilt_warning_deg: is 5.0; must be a number at least 10 and at most 180, in degrees",
        ),
        (
            "landing: {land_second_route_after_s: 0.4, descent_time_s: 0.1}",
            "landing.land_second_route_after_s: is 0.4; must be above landing.land_repeat_period_s (0.5): "
            "LAND is repeated before",
        ),
        (
            "landing: {land_repeat_period_s: 2.0}",
            "landing.land_repeat_period_s: is 2.0; must be a number above 0 and at most 1, in seconds",
        ),
        (
            "landing: {descent_time_s: 3.0}",
            "landing.descent_time_s: is 3; must be below landing.land_second_route_after_s (3): "
            "else no descent is seen before",
        ),
        (
            "landing: {land_alarm_after_s: 2.0}",
            "landing.land_alarm_after_s: is 2; must be at least landing.land_second_route_after_s (3): "
            "the pilot is the last route",
        ),
        (
            "landing: {land_limit_s: 6.0}",
            "landing.land_limit_s: is 6; must be above landing.land_alarm_after_s (6): the pilot needs time to land it",
        ),
        (
            "landing: {ground_disarm_after_s: 10.0}",
            "landing.ground_disarm_after_s: is 10; must be below landing.confirm_limit_s (10): "
            "else it is never disarmed in time",
        ),
        (
            "landing: {confirm_limit_s: 120.0}",
            "landing.confirm_limit_s: is 120; must be below landing.land_limit_s (120): "
            "the pilot needs time to stop the motors",
        ),
        (
            "failsafe: {clock_tolerance_s: 1.0}",
            "failsafe.clock_tolerance_s: is 1; must be below failsafe.status_max_age_s (1): "
            "else the future passes for the present",
        ),
        (
            "battery: {battery_critical_fraction: 0.25}",
            "battery.battery_critical_fraction: is 0.25; must be at most battery.battery_reserve_fraction (0.2): "
            "else every mission ends by it",
        ),
        (
            "commands: {user_hold_limit_s: 900.0}",
            "commands.user_hold_limit_s: is 900; must be below flight.max_flight_time_s (900): "
            "else a hold outlasts the flight",
        ),
        (
            "commands: {hold_repeat_after_s: 3.0}",
            "commands.hold_repeat_after_s: is 3; must be below commands.hold_confirm_limit_s (3): "
            "else one lost request ends in a landing",
        ),
        (
            "commands: {hold_confirm_limit_s: 1.5}",
            "commands.hold_confirm_limit_s: is 1.5; must be above commands.hold_repeat_after_s (1.5): "
            "else one lost request ends in a landing",
        ),
        (
            "failsafe: {watchdog_heartbeat_limit_s: 0.1}",
            "failsafe.watchdog_heartbeat_limit_s: is 0.1; must be at least 0.4, 2 periods of "
            "streams.watchdog_action_rate_hz: one lost message is no loss",
        ),
        (
            "streams: {recorder_status_rate_hz: 0.5}\nfailsafe: {recorder_status_limit_s: 3.0}",
            "failsafe.recorder_status_limit_s: is 3; must be at least 4, 2 periods of streams.recorder_status_rate_hz: "
            "one lost message is no loss",
        ),
    ],
)
def test_limits_that_cannot_be_together_are_refused(mistake, text, message):
    line = len(text.splitlines())
    assert mistake("autonomy.yaml", text + "\n") == f"autonomy.yaml:{line}: {message}"


def test_the_key_that_the_file_gives_is_the_one_that_is_named(mistake):
    message = mistake("autonomy.yaml", "landing:\n  land_limit_s: 3.5\n  land_alarm_after_s: 3.5\n")
    assert message.startswith("autonomy.yaml:3: landing.land_alarm_after_s: is 3.5; must be below landing.land_limit_s")


def test_limits_may_be_equal_where_nothing_is_wrong_with_that(small):
    (small / "autonomy.yaml").write_text(
        "landing: {land_alarm_after_s: 3.0}\nbattery: {battery_critical_fraction: 0.2}\n"
    )
    assert load_configuration(small).rules.limits.land_alarm_after_ns == 3_000_000_000
