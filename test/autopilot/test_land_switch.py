"""A switch of the transmitter that means: land. Held for a while, by fresh channels, over MAVLink and mavros alike."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.mavros.messages import Converter, sources_of
from amaze_autonomy.autopilot.vehicle.client import AutopilotClient, switch_messages
from amaze_autonomy.autopilot.vehicle.preflight import LandSwitchWatch
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.config.autopilot_schema import LandSwitch
from amaze_autonomy.engine.events import Verdict
from amaze_autonomy.monitoring.specs import BatterySpec

S, MS = 1_000_000_000, 1_000_000
ON, OFF = 1900, 1100


def channels(width_us, count=8, number=7):
    widths = [1500] * count + [65535] * (18 - count)
    widths[number - 1] = width_us
    return mavlink.MAVLink_rc_channels_message(0, count, *widths, 200)


def heard(*readings, **settings):
    """Return a switch on channel 7 that has heard (milliseconds, width) each."""
    switch = LandSwitchWatch(LandSwitch(channel=7, **settings))
    for t_ms, width_us in readings:
        switch.add(t_ms * MS, channels(width_us))
    return switch


@pytest.mark.parametrize(
    "readings, on",
    [
        ([], None),
        ([(0, OFF)], False),
        ([(0, ON)], False),  # not long enough yet
        ([(0, ON), (299, ON)], False),
        ([(0, ON), (300, ON)], True),
        ([(0, ON), (200, OFF), (400, ON)], False),  # a single reading begins anew
        ([(0, ON), (300, ON), (400, OFF)], False),
        ([(0, ON), (300, 1700)], False),  # not above
        ([(0, ON), (1301, ON)], False),  # nothing is known of the time between
        ([(0, ON), (300, 0)], False),  # no pulse is no reading
        ([(0, ON), (300, 65535)], False),
    ],
)
def test_it_is_on_when_it_was_held(readings, on):
    last_ms = readings[-1][0] if readings else 0
    assert heard(*readings).on(last_ms * MS) is on


def test_what_is_old_says_nothing():
    switch = heard((0, ON), (400, ON))
    assert switch.on(1400 * MS) is True
    assert switch.on(1401 * MS) is None


def test_time_alone_does_not_hold_it():
    switch = heard((0, ON))
    assert switch.on(900 * MS) is False


def test_a_channel_that_the_transmitter_has_not_says_nothing():
    switch = LandSwitchWatch(LandSwitch(channel=9))
    switch.add(0, channels(ON, count=8))
    assert switch.on(0) is None


@pytest.mark.parametrize(
    "width_us, verdict, advice",
    [
        (OFF, Verdict.PASS, ""),
        (ON, Verdict.FAIL, "switch it back: it says land"),
        (None, Verdict.UNKNOWN, "channel 7 is not heard"),
    ],
)
def test_nothing_takes_off_with_it_on_or_unheard(width_us, verdict, advice):
    client = AutopilotClient(
        replace(AutopilotSettings(), land_switch=LandSwitch(channel=7)), BatterySpec(), lambda: (1, 1)
    )
    for t_ms in (0, 400):
        beat = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 1, 4 << 16, 3, 3)
        client.receive(t_ms * MS, beat)
        if width_us is not None:
            client.receive(t_ms * MS, channels(width_us))
    row = next(row for row in client.rows(400 * MS, None) if row.name == "land switch")
    assert (row.verdict, row.advice) == (verdict, advice)


def test_without_a_channel_there_is_no_row_and_nothing_is_asked_for():
    client = AutopilotClient(AutopilotSettings(), BatterySpec(), lambda: (1, 1))
    assert "land switch" not in {row.name for row in client.rows(0, None)}
    assert switch_messages(AutopilotSettings()) == ()


def test_mavros_tells_the_same():
    (source,) = sources_of(["RC_CHANNELS"])
    assert (source.topic, source.kind) == ("rc/in", "mavros_msgs/RCIn")
    widths = [1500] * 6 + [ON, 1500]
    made = Converter().convert(source, SimpleNamespace(rssi=200, channels=widths))
    assert (made.chancount, made.chan7_raw, made.chan9_raw) == (8, ON, 65535)
