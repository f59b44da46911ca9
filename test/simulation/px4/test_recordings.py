"""The simulated PX4 against recordings of the real one: the same messages in, the same story out."""

from __future__ import annotations

import pytest
from px4_tools import changes, rates, replayed

# Texts that only the recorded vehicle has: they come from parts that are not simulated, or from its own simulation.
_NOT_SIMULATED = ("[logger]", "Climb to", "System does not support", "Preflight")
# What a recording shows that is not a matter of the flight: its simulated battery is full again after landing.
_RECHARGED = ("charge 1",)


@pytest.fixture(scope="module", params=[
    ("px4_normal_mission", 100_000.0, 5.0),
    ("px4_gps_loss_param", 100_000.0, 3.5),
    ("px4_battery_drain", 61.2, 5.0),
    ("px4_offboard", 100_000.0, 4.5),
], ids=lambda each: each[0])  # fmt: skip
def both(request):
    name, endurance_s, late_s = request.param
    recorded, simulated = replayed(name, endurance_s)
    return name, recorded, simulated, late_s


def _story(messages):
    """Return the changes in which both must agree."""
    return [row for row in changes(messages) if row[1] not in _RECHARGED]


def _by_name(rows):
    """Return what -> times, in order."""
    table = {}
    for t_s, what in rows:
        table.setdefault(what.split()[0], []).append((t_s, what))
    return table


@pytest.mark.slow_rows
def test_mode_armed_landed_and_items_change_in_the_same_order_at_about_the_same_time(both):
    name, recorded, simulated, late_s = both
    expected, got = _by_name(_story(recorded)), _by_name(_story(simulated))
    assert {what: [row[1] for row in rows] for what, rows in got.items()} == {
        what: [row[1] for row in rows] for what, rows in expected.items()
    }
    for what, rows in expected.items():
        for (t_s, text), (simulated_s, _) in zip(rows, got[what]):
            assert simulated_s == pytest.approx(t_s, abs=late_s), f"{name}: {text}"


def test_commands_are_acknowledged_as_in_the_recording(both):
    _, recorded, simulated, _ = both

    def acks(messages):
        return [(m.command, m.result) for _, m in messages if m.get_type() == "COMMAND_ACK"]

    expected, got = acks(recorded), acks(simulated)
    if expected and expected[0] == (512, 0) and got.count((512, 0)) > expected.count((512, 0)):
        got.remove((512, 0))  # one that the recorded vehicle did not acknowledge
    assert got == expected


@pytest.mark.slow_rows
def test_texts_are_those_of_the_recording(both):
    _, recorded, simulated, _ = both

    def texts(messages):
        told = [(m.severity, m.text) for _, m in messages if m.get_type() == "STATUSTEXT"]
        kept = [row for row in told if not row[1].startswith(_NOT_SIMULATED)]
        return kept[:-1] if kept and kept[-1] == (0, "Low battery\t") else kept

    assert sorted(texts(simulated)) == sorted(texts(recorded))


def test_the_mission_is_asked_for_as_in_the_recording(both):
    _, recorded, simulated, _ = both
    kinds = ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK", "MISSION_COUNT")

    def transfer(messages):
        return [(m.get_type(), getattr(m, "seq", None)) for _, m in messages if m.get_type() in kinds]

    assert transfer(simulated) == transfer(recorded)


def test_the_same_messages_are_streamed_at_the_same_rates(both):
    _, recorded, simulated, _ = both
    expected, got = rates(recorded, 3.0, 40.0), rates(simulated, 3.0, 40.0)
    streamed = {kind: rate for kind, rate in expected.items() if rate > 0.2 and kind not in _OTHER}
    assert set(got) >= set(streamed)
    for kind, rate in streamed.items():
        assert got[kind] == pytest.approx(rate, rel=0.25, abs=0.1), kind


_OTHER = (
    "STATUSTEXT", "COMMAND_ACK", "PARAM_VALUE", "MISSION_ITEM_REACHED", "POSITION_TARGET_GLOBAL_INT",
    "OPEN_DRONE_ID_LOCATION", "OPEN_DRONE_ID_SYSTEM",
)  # fmt: skip


def _flags(messages):
    """Return the values of ESTIMATOR_STATUS.flags as they change, without the one about the terrain."""
    values = []
    for _, message in messages:
        if message.get_type() == "ESTIMATOR_STATUS":
            flags = message.flags & ~0b1000000
            if not values or values[-1] != flags:
                values.append(flags)
    return values


def test_the_estimator_says_the_same(both):
    name, recorded, simulated, _ = both
    if name == "px4_gps_loss_param":
        # The recorded one also tells of steps in its return, and gives up on the ground what it predicts.
        assert _flags(simulated)[:4] == _flags(recorded)[:4]
    else:
        expected = _flags(recorded)  # it may end before the motors have been off for long enough
        assert _flags(simulated)[: len(expected)] == expected


def _words(messages):
    """Return (present, enabled, enabled but unhealthy) of SYS_STATUS as they change, without the log's bit."""
    words = []
    for _, message in messages:
        if message.get_type() != "SYS_STATUS":
            continue
        present, enabled = message.onboard_control_sensors_present, message.onboard_control_sensors_enabled
        word = tuple(
            bits & ~(1 << 24) for bits in (present, enabled, enabled & ~message.onboard_control_sensors_health)
        )
        if not words or words[-1] != word:
            words.append(word)
    return words


def test_sensors_are_present_enabled_and_healthy_as_in_the_recording(both):
    name, recorded, simulated, _ = both
    expected, got = _words(recorded), _words(simulated)
    if name == "px4_battery_drain":
        expected, got = expected[:2], got[:2]  # its battery is charged by magic after the landing
    if name == "px4_gps_loss_param":
        expected, got = expected[:3], got[:3]  # on the ground it looks for the GPS step by step
    assert got == expected
