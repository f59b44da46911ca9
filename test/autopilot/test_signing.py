from __future__ import annotations

import os

import pytest
from autopilot_tools import beat
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot.errors import KeyFileError
from amaze_autonomy.autopilot.link.wire import Wire, read_key

KEY, OTHER = bytes(range(32)), bytes(32)
NOW_NS = 1_800_000_000_000_000_000
S = 1_000_000_000


def wires():
    return Wire(1, 1, key=KEY), Wire(1, 191, key=KEY)


def test_what_is_signed_with_our_key_is_heard():
    theirs, ours = wires()
    heard = [ours.receive(theirs.send(beat(), NOW_NS + at), None, NOW_NS) for at in range(3)]
    assert [len(messages) for messages in heard] == [1, 1, 1]
    assert ours.verifier.refused == 0


def test_pymavlink_accepts_what_we_sign():
    mav = mavlink.MAVLink(None)
    mav.signing.secret_key = KEY
    mav.signing.timestamp = 1
    _, ours = wires()
    message = mav.decode(bytearray(ours.send(beat(), NOW_NS)))
    assert message.get_signed()


def test_of_what_is_signed_and_not_wanted_the_frame_is_known():
    """Its number is one of the vehicle's: without it those of the wanted ones would seem to jump."""
    theirs, ours = Wire(1, 1, key=KEY), Wire(191, 245, ("HEARTBEAT",), KEY)
    other = mavlink.MAVLink_vfr_hud_message(0, 0, 0, 0, 0, 0)
    raw = [theirs.send(each, NOW_NS + at * 10_000) for at, each in enumerate((beat(), other, beat()))]
    raw.append(Wire(1, 1, key=OTHER).send(other, NOW_NS))
    found = [each for data in raw for each in ours.each(data, None, NOW_NS)]
    assert [(frame.sequence, message is not None) for frame, message in found] == [(0, True), (1, False), (2, True)]
    assert ours.verifier.refused == 1


@pytest.mark.parametrize("key", [None, OTHER])
def test_what_is_not_signed_with_our_key_is_not_heard(key):
    ours = wires()[1]
    assert ours.receive(Wire(1, 1, key=key).send(beat(), NOW_NS), None, NOW_NS) == []
    assert ours.verifier.refused == 1


def test_what_is_sent_again_is_not_heard_again():
    theirs, ours = wires()
    raw = theirs.send(beat(), NOW_NS)
    assert [len(ours.receive(raw, None, NOW_NS)) for _ in range(2)] == [1, 0]


def test_an_old_recording_is_not_heard():
    theirs, ours = wires()
    assert ours.receive(theirs.send(beat(), NOW_NS - 61 * S), None, NOW_NS) == []
    assert len(ours.receive(theirs.send(beat(), NOW_NS - 59 * S), None, NOW_NS)) == 1


def test_our_time_follows_a_vehicle_that_is_ahead():
    theirs, ours = wires()
    ours.receive(theirs.send(beat(), NOW_NS + 3600 * S), None, NOW_NS)
    assert len(theirs.receive(ours.send(beat(), NOW_NS), None, NOW_NS + 3600 * S)) == 1


def test_a_damaged_signature_is_refused():
    theirs, ours = wires()
    raw = bytearray(theirs.send(beat(), NOW_NS))
    raw[-1] ^= 1
    assert ours.receive(bytes(raw), None, NOW_NS) == []


def test_the_radio_has_no_key_and_is_heard():
    radio = mavlink.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7)
    assert len(wires()[1].receive(Wire(51, 68).send(radio), None, NOW_NS)) == 1


def key_file(folder, content, mode=0o600):
    path = folder / "key"
    path.write_bytes(content)
    path.chmod(mode)
    return path


@pytest.mark.parametrize("content", [KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n"])
def test_a_key_is_32_bytes_or_64_digits(tmp_path, content):
    assert read_key(key_file(tmp_path, content)) == KEY


@pytest.mark.parametrize(
    "content, mode, words",
    [
        (b"", 0o600, "holds 0 bytes"),
        (b"secret", 0o600, "holds no key"),
        (b"00ff", 0o600, "holds 2 bytes"),
        (b"\xff" * 33, 0o600, "holds no key"),
        (KEY, 0o644, "others may read or write the key"),
    ],
)
def test_what_is_no_key_is_refused(tmp_path, content, mode, words):
    path = key_file(tmp_path, content, mode)
    with pytest.raises(KeyFileError) as caught:
        read_key(path)
    assert (caught.value.what, caught.value.wrong) == (str(path), words)


def test_a_key_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(KeyFileError, match="No such file"):
        read_key(tmp_path / "none")


def test_a_key_that_is_a_fifo_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(str(tmp_path / "key"), 0o600)
    with pytest.raises(KeyFileError, match="is no file; must be a file with the key"):
        read_key(tmp_path / "key")
