"""The checksum of a longer content is told from that of the shorter one; what lz4 itself says is the truth."""

from __future__ import annotations

import lz4.frame
import pytest
from hypothesis import given
from hypothesis import strategies as st

from amaze_autonomy.bags.xxh32 import STRIPE, lengthened, neutral_stripe


def checksum(content):
    """Return the last four bytes of a frame: the checksum of its content."""
    return int.from_bytes(lz4.frame.compress(content, content_checksum=True)[-4:], "little")


def stripes(most):
    return st.integers(0, most).flatmap(lambda count: st.binary(min_size=count * STRIPE, max_size=count * STRIPE))


@given(content=st.binary(min_size=STRIPE, max_size=200), before=stripes(5), behind=stripes(3))
def test_any_beginning_becomes_invisible(content, before, behind):
    beginning = before + neutral_stripe(before, behind) + behind
    end = content[len(content) // STRIPE * STRIPE :]
    assert checksum(beginning + content) == lengthened(checksum(content), len(beginning), end)


@given(content=st.binary(min_size=STRIPE, max_size=99), claimed=st.integers(0, 2**32 - 1))
def test_a_checksum_that_was_wrong_stays_wrong(content, claimed):
    beginning = neutral_stripe(b"", b"")
    end = content[len(content) // STRIPE * STRIPE :]
    same = lengthened(claimed, STRIPE, end) == checksum(beginning + content)
    assert same is (claimed == checksum(content))


@pytest.mark.parametrize("size", range(STRIPE))
def test_every_length_of_an_end(size):
    content = bytes(range(64 + size))
    beginning = bytes(16) + neutral_stripe(bytes(16), b"\xff" * 32) + b"\xff" * 32
    assert checksum(beginning + content) == lengthened(checksum(content), len(beginning), content[64:])
