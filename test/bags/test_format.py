"""Records and chunks of a bag: what is not what its header says is an error."""

from __future__ import annotations

import pytest
from bag_tools import COMPRESSIONS

from amaze_autonomy.bags.format import RecordError, compressed, decompressed


@pytest.mark.parametrize("kind", COMPRESSIONS)
def test_a_chunk_is_decompressed_to_what_was_compressed(kind):
    assert bytes(decompressed(kind, compressed(kind, b"abc"), 3)) == b"abc"


@pytest.mark.parametrize("size", [0, 2, 4])
@pytest.mark.parametrize("kind", COMPRESSIONS)
def test_a_chunk_of_another_size_than_its_header_says_is_damaged(kind, size):
    with pytest.raises(RecordError) as caught:
        decompressed(kind, compressed(kind, b"abc"), size)
    words = f"it has more than {size}" if size < 3 else f"it has 3 bytes instead of {size}"
    assert str(caught.value) == words
