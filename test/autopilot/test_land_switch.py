"""The switch that means land is read, and is a row before takeoff, over MAVLink and mavros alike."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from client_bench import ClientBench

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.mavros.messages import Converter, sources_of
from amaze_autonomy.autopilot.vehicle.client import AutopilotClient, switch_messages
from amaze_autonomy.autopilot.vehicle.preflight import channel_width_us
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.events import Verdict
from amaze_autonomy.monitoring.land_switch import LandSwitchSpec
from amaze_autonomy.monitoring.specs import BatterySpec

MS = 1_000_000
ON, OFF = 1900, 1100


def channels(width_us, count=8, number=7):
    widths = [1500] * count + [65535] * (18 - count)
    widths[number - 1] = width_us
    return mavlink.MAVLink_rc_channels_message(0, count, *widths, 200)


@pytest.mark.parametrize(
    "message, width_us",
    [
        (channels(ON), 1900.0),
        (channels(0), None),  # no pulse
        (channels(65535), None),
        (channels(ON, count=6), None),  # the transmitter has no such channel
    ],
)
def test_a_pulse_that_is_not_there_is_none(message, width_us):
    assert channel_width_us(message, 7) == width_us


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
        replace(AutopilotSettings(), land_switch=LandSwitchSpec(channel=7)), BatterySpec(), lambda: (1, 1)
    )
    for t_ms in range(0, 1600, 100):
        beat = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 1, 4 << 16, 3, 3)
        client.receive(t_ms * MS, beat)
        if t_ms % 500 == 0:
            system = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 15000, -1, 90, 0, 0, 0, 0, 0, 0)
            client.receive(t_ms * MS, system)
        if width_us is not None:
            client.receive(t_ms * MS, channels(width_us))
    row = next(row for row in client.rows(1500 * MS, None) if row.name == "land switch")
    assert (row.verdict, row.advice) == (verdict, advice)


@pytest.mark.parametrize("autopilot", [mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA])
@pytest.mark.parametrize("width_us", [OFF, ON])
def test_channels_of_a_transmitter_that_is_not_heard_say_nothing(autopilot, width_us):
    """Its receiver repeats them, or sends those that it was taught for a failsafe."""
    client = AutopilotClient(
        replace(AutopilotSettings(), land_switch=LandSwitchSpec(channel=7)), BatterySpec(), lambda: (1, 1)
    )

    receiver = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    for t_ms in range(0, 3000, 100):
        client.receive(t_ms * MS, mavlink.MAVLink_heartbeat_message(2, autopilot, 1, 4 << 16, 3, 3))
        system = mavlink.MAVLink_sys_status_message(0, receiver, 0, 0, 15000, -1, 90, 0, 0, 0, 0, 0, 0)
        client.receive(t_ms * MS, system)
        client.receive(t_ms * MS, channels(width_us))
    row = next(row for row in client.rows(2900 * MS, None) if row.name == "land switch")
    assert (client.land_switch.on(2900 * MS), row.verdict) == (None, Verdict.UNKNOWN)


def flown(phase_ms):
    """Return a vehicle that flies, its client with a land switch, some time after its last SYS_STATUS."""
    settings = replace(AutopilotSettings(), land_switch=LandSwitchSpec(channel=7))
    bench = ClientBench(settings=settings, land_channel=7).fly()
    reports = bench.vehicle.system.sequence
    return bench.until(lambda: bench.vehicle.system.sequence > reports, 2.0).advance(phase_ms / 1000)


def says_land_after_s(bench, limit_s):
    """Return when the switch says land; None: not within that time."""
    begin_ns = bench.t_ns
    while bench.t_ns < begin_ns + round(limit_s * 1000 * MS):
        bench.step()
        if bench.client.land_switch.on(bench.t_ns):
            return (bench.t_ns - begin_ns) / (1000 * MS)
    return None


@pytest.mark.parametrize("phase_ms", range(0, 500, 100))
def test_a_receiver_that_makes_its_channels_up_lands_nobody(phase_ms):
    """Every channel at 2000 us, at once: PX4 notices half a second later, and says so within another half."""
    bench = flown(phase_ms)
    bench.far.craft.flags.not_ready["rc"] = "no transmitter"
    assert says_land_after_s(bench, 3.0) is None
    assert bench.far.last("RC_CHANNELS").chan7_raw == 2000, "made up all the while"


@pytest.mark.parametrize("phase_ms", range(0, 500, 100))
def test_a_pilot_who_throws_it_needs_not_to_wait_for_long(phase_ms):
    bench = flown(phase_ms)
    bench.far.craft.flags.land_switch = True
    assert 0.7 <= says_land_after_s(bench, 3.0) <= 1.4


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
