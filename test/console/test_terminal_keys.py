"""Bytes become keys; sequences and pasted text become nothing."""

from __future__ import annotations

import pytest

from amaze_autonomy.console.terminal import KeyDecoder


@pytest.mark.parametrize(
    "data, keys",
    [
        (b"lY1", ["l", "Y", "1"]),
        (b"\r", ["enter"]),
        (b"\n", ["enter"]),
        (b"\x7f\x08", ["backspace", "backspace"]),
        (b"\x15", ["clear"]),
        (b"\x03\x04", ["quit", "quit"]),
        ("ü→".encode(), ["ü", "→"]),
        (b"\x1b[Al", ["up", "l"]),
        (b"\x1b[B\x1bOA\x1b[5~\x1b[6~", ["down", "up", "page up", "page down"]),
        (b"\x1bOPl", ["l"]),
        (b"\x1b[15;5~l", ["l"]),
        (b"\x1b[<0;10;20Ml", ["l"]),
        (b"\x1bly", ["escape", "l", "y"]),
        (b"\x1b\r", ["escape", "enter"]),
        (b"\x1b\x1b[Al", ["escape", "up", "l"]),
        ("\x1bü".encode(), ["escape", "ü"]),
        (b"\x00\x01\x11\x1a\x1c\xc2\x85", []),
        (b"\xff\xfel", ["l"]),
        (b"\x1b[200~l\ny\x1b[201~h", ["h"]),
    ],
)
def test_keys_of_bytes(data, keys):
    assert KeyDecoder().feed(data) == keys


@pytest.mark.parametrize("data", ["aü→\x1b[A\x1b[200~l\ny\x1b[201~b\x1b[15;5~c".encode()])
def test_pieces_of_any_size_give_the_same_keys(data):
    for size in range(1, len(data) + 1):
        decoder = KeyDecoder()
        pieces = [data[at : at + size] for at in range(0, len(data), size)]
        assert [key for piece in pieces for key in decoder.feed(piece)] == ["a", "ü", "→", "up", "b", "c"]


def test_a_lone_escape_is_the_escape_key_after_a_pause():
    decoder = KeyDecoder()
    assert (decoder.feed(b"\x1b"), decoder.flush(), decoder.flush()) == ([], ["escape"], [])


def test_a_pause_within_a_sequence_drops_it():
    decoder = KeyDecoder()
    assert (decoder.feed(b"\x1b["), decoder.flush(), decoder.feed(b"l")) == ([], [], ["l"])


def test_a_pause_within_pasted_text_does_not_let_it_through():
    decoder = KeyDecoder()
    assert (decoder.feed(b"\x1b[200~l"), decoder.flush(), decoder.feed(b"y\x1b[201~h")) == ([], [], ["h"])


@pytest.mark.parametrize(
    "begun", [b"\x1b[200~some te", b"\x1b[200~some te\x1b[20", b"\x1b[", b"\x1bO", "ü".encode()[:1]]
)
def test_what_was_begun_and_never_ended_is_forgotten(begun):
    decoder = KeyDecoder()
    assert (decoder.feed(begun), decoder.forget(), decoder.feed(b"l\r")) == ([], None, ["l", "enter"])


def test_a_sequence_without_an_end_is_forgotten():
    decoder = KeyDecoder()
    assert decoder.feed(b"\x1b[" + b"0" * 100) == []
    assert decoder.feed(b"l") == ["l"]
