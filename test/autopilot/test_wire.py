from __future__ import annotations

import struct

from autopilot_tools import beat
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from amaze_autonomy.autopilot.link.framing import LONGEST, FrameReader, crc16
from amaze_autonomy.autopilot.link.wire import Wire, decode

TEXT = mavlink.MAVLink_statustext_message(6, b"Takeoff detected\t")
BATTERY = mavlink.MAVLink_battery_status_message(0, 0, 0, 2500, [4100] * 4 + [65535] * 6, 120, 5, 6, 88, 60, 1, [0] * 4)


def frames(*messages, wire=None):
    wire = wire or Wire(1, 1)
    return [wire.send(message) for message in messages]


@given(st.binary(max_size=300))
def test_the_checksum_is_that_of_mavlink(data):
    assert crc16(data) == x25crc(data).crc


def test_messages_come_out_as_they_went_in():
    heard = Wire(1, 191).receive(b"".join(frames(beat(3), TEXT, BATTERY)))
    assert [message.to_dict() for message in heard] == [each.to_dict() for each in (beat(3), TEXT, BATTERY)]
    assert [(m.get_srcSystem(), m.get_srcComponent(), m.get_seq()) for m in heard] == [(1, 1, 0), (1, 1, 1), (1, 1, 2)]


def test_every_message_of_the_dialect_is_decoded_as_pymavlink_does():
    assert len(mavlink.mavlink_map) > 200
    for number, kind in sorted(mavlink.mavlink_map.items()):
        payload = bytes((7 * at + number) % 251 + 1 for at in range(kind.unpacker.size))[:255]
        head = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, 9, 1, 1, number & 0xFFFF, number >> 16)
        crc = crc16(head[1:] + payload + bytes((kind.crc_extra,)))
        raw = head + payload + struct.pack("<H", crc)
        (frame,) = FrameReader().feed(raw)
        theirs = mavlink.MAVLink(None).decode(bytearray(raw))
        assert repr(decode(frame).to_dict()) == repr(theirs.to_dict())


def test_only_wanted_messages_are_decoded():
    wire = Wire(1, 191, wanted=["STATUSTEXT"])
    heard = wire.receive(b"".join(frames(beat(), TEXT, BATTERY)))
    assert [message.get_type() for message in heard] == ["STATUSTEXT"]
    assert wire.tally.good == 3


def test_version_1_is_understood():
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    raw = TEXT.pack(mav, force_mavlink1=True)
    assert raw[0] == 0xFE
    assert [message.text for message in Wire(1, 191).receive(raw)] == ["Takeoff detected\t"]


def test_frames_of_unknown_ids_are_skipped_whole():
    event = bytes((0xFD, 4, 0, 0, 0, 1, 1, 411 & 0xFF, 411 >> 8, 0)) + b"\xfd\xfe\xfd\xfe" + b"xx"
    wire = Wire(1, 191)
    heard = wire.receive(event + frames(TEXT)[0] + event)
    assert [message.get_type() for message in heard] == ["STATUSTEXT"]
    assert (wire.tally.unknown, wire.tally.damaged_bytes) == (2, 0)


def test_a_frame_with_flags_that_are_not_understood_is_none():
    raw = bytearray(frames(TEXT)[0])
    raw[2] = 0x02
    crc = crc16(bytes(raw[1:-2]) + bytes((mavlink.mavlink_map[253].crc_extra,)))
    assert Wire(1, 191).receive(bytes(raw[:-2]) + struct.pack("<H", crc)) == []


def test_sources_are_not_put_together():
    first, second = frames(TEXT)[0], frames(BATTERY)[0]
    wire = Wire(1, 191)
    assert wire.receive(first[:10], "a") == []
    assert [m.get_type() for m in wire.receive(second, "b")] == ["BATTERY_STATUS"]
    assert [m.get_type() for m in wire.receive(first[10:], "a")] == ["STATUSTEXT"]


def test_many_sources_take_bounded_memory():
    wire = Wire(1, 191)
    for source in range(1000):
        wire.receive(frames(TEXT)[0][:20], source)
    assert wire.kept <= 16 * LONGEST


@given(st.binary(max_size=40), st.binary(max_size=40), st.lists(st.integers(1, 60), max_size=20))
@settings(max_examples=60, deadline=None)
def test_noise_and_cuts_cost_no_frame_that_follows(before, between, cuts):
    """Noise may hold back what follows until a frame's length has passed, never longer."""
    raw = before + frames(TEXT)[0] + between + frames(BATTERY)[0] + bytes(LONGEST)
    wire, at = Wire(1, 191), 0
    heard = []
    for cut in [*cuts, len(raw)]:
        heard += wire.receive(raw[at : at + cut])
        at += cut
    names = [message.get_type() for message in heard]
    assert [name for name in names if name in ("STATUSTEXT", "BATTERY_STATUS")] == ["STATUSTEXT", "BATTERY_STATUS"]


@given(st.data())
@settings(max_examples=100, deadline=None)
def test_a_damaged_frame_is_none(data):
    raw = bytearray(frames(BATTERY)[0])
    at = data.draw(st.integers(0, len(raw) - 1))
    raw[at] ^= data.draw(st.integers(1, 255))
    heard = Wire(1, 191).receive(bytes(raw) + bytes(LONGEST))
    assert [message for message in heard if message.get_type() == "BATTERY_STATUS"] == []
