"""Stretches of files, read before they are wanted."""

from __future__ import annotations

import os

import pytest

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.write import Ahead, Stretch

MEGABYTE = 1 << 20


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "input"
    path.write_bytes(os.urandom(5 * MEGABYTE + 3))
    number = os.open(path, os.O_RDONLY)
    yield number, path.read_bytes(), path
    os.close(number)


@pytest.fixture
def ahead(tmp_path):
    reader = Ahead(tmp_path / "output.bag")
    yield reader
    reader.stop()


def whole(ahead, stretch):
    return b"".join(bytes(piece) for piece in ahead.bytes_of(stretch))


def test_what_was_expected_comes_in_its_order_whatever_its_size(ahead, file):
    number, content, _ = file
    stretches = [
        Stretch(number, 0, 5 * MEGABYTE + 3),
        Stretch(number, 7, 1),
        Stretch(number, 9, 0),
        *(Stretch(number, start, MEGABYTE + 1) for start in range(0, 4 * MEGABYTE, 300_000)),
    ]
    ahead.expect(stretches[:3])
    ahead.expect(stretches[3:])
    for stretch in stretches:
        assert whole(ahead, stretch) == content[stretch.start : stretch.start + stretch.size]


def test_what_was_not_expected_is_read_when_it_is_wanted(ahead, file):
    number, content, _ = file
    assert whole(ahead, Stretch(number, 5, 2 * MEGABYTE)) == content[5 : 5 + 2 * MEGABYTE]
    assert whole(ahead, Stretch(number, 1, 10)) == content[1:11]


def test_another_one_than_was_expected_is_a_mistake(ahead, file):
    ahead.expect([Stretch(file[0], 0, 10)])
    with pytest.raises(ValueError, match="was said to be next"):
        whole(ahead, Stretch(file[0], 1, 10))


def test_an_input_that_became_shorter_is_named(ahead, file):
    number, _, path = file
    with path.open("r+b") as shortened:
        shortened.truncate(MEGABYTE + 5)
    with pytest.raises(BagError, match="became shorter"):
        whole(ahead, Stretch(number, 0, 2 * MEGABYTE))
