"""Stretches of files, read before they are wanted; who may read what is written of them."""

from __future__ import annotations

import fcntl
import os

import pytest

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.write import Ahead, Output, Stretch

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


@pytest.mark.usefixtures("umask_of_nodes")
@pytest.mark.parametrize("others", [0o666, 0o644], ids=oct)
@pytest.mark.parametrize("name", ["x.bag", ".x.bag.part"], ids=["replaced", "left by a killed process"])
def test_the_mode_of_a_bag_is_that_of_a_new_file(tmp_path, name, others):
    (tmp_path / name).write_bytes(b"old")
    (tmp_path / name).chmod(others)
    with Output(tmp_path / "x.bag", replace=True) as output:
        output.close({})
    assert [(path.name, oct(path.stat().st_mode & 0o777)) for path in tmp_path.iterdir()] == [("x.bag", "0o640")]


def test_what_another_process_writes_is_not_taken_for_what_a_killed_one_left(tmp_path):
    part = tmp_path / ".x.bag.part"
    with part.open("wb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(BagError, match="is being written by another process"):
            Output(tmp_path / "x.bag")
        assert os.path.samestat(os.fstat(other.fileno()), part.stat())
