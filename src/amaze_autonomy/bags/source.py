"""One input of a merge: its chunks in order of time, loaded a few megabytes at a time."""

from __future__ import annotations

from functools import cached_property
from itertools import groupby, islice
from typing import TYPE_CHECKING, Any, List, NamedTuple, Optional, Set

from .index import ChunkHead, Index
from .loading import GROUP_BYTES, Block, Loader, Pool
from .table import relabel

if TYPE_CHECKING:
    from .carriers import Carriers

__all__ = ["Group", "Source"]

_SAMPLE = 3
_BESIDE = 200  # bytes that the output has for a chunk beside its data


class Group(NamedTuple):
    """Chunks to be loaded together, or one to be copied as it is."""

    source: Source
    chunks: List[int]
    verbatim: bool

    @property
    def size(self) -> int:
        """Return its bytes in the input."""
        chunks = self.source.index.chunks
        return sum(chunks[number].end - chunks[number].position for number in self.chunks)

    @property
    def first_ns(self) -> int:
        """Return the time of its first message."""
        return self.source.start_ns(self.chunks[0])

    def load(self, pool: Pool) -> List[Block]:
        """Read, check and relabel the messages."""
        return self.source.load(self.chunks, pool)


class Source:
    """Reads a bag's chunks in order of their first messages.

    Args:
        index: of the bag.
        number: of the input.
        target: the connection's number in the output, by its number here.
        shift_ns: added to record times.
        verbatim: chunks that are copied as they are.
        unseen: for each connection here, whether the bytes of its messages need not be seen.
        carriers: loads chunks that are to stay compressed; None when none is.
    """

    def __init__(
        self,
        index: Index,
        number: int,
        target: Any,
        shift_ns: int,
        verbatim: Set[int],
        unseen: Any,
        carriers: Optional[Carriers] = None,
    ) -> None:
        self.index, self.number = index, number
        self._loader, self._carriers = Loader(index, number, unseen), carriers
        self._target, self._shift_ns, self._verbatim = target, shift_ns, verbatim
        chunks = index.chunks
        self._order = [
            each
            for each in sorted(range(len(chunks)), key=lambda each: (chunks[each].start_ns, each))
            if chunks[each].counts
        ]
        self._next = 0

    @property
    def next_ns(self) -> int:
        """Return the time before which nothing more will come; only when there is more."""
        return self.start_ns(self._order[self._next])

    def start_ns(self, chunk: int) -> int:
        """Return the time of a chunk's first message in the output."""
        return self.index.chunks[chunk].start_ns + self._shift_ns

    @property
    def more(self) -> bool:
        """Return whether something will come."""
        return self._next < len(self._order)

    def needed(self) -> int:
        """Return how many bytes an output takes that is compressed only where it stays so."""
        return sum(self._space(self.index.head(each), each) + _BESIDE for each in self._order)

    def _space(self, head: ChunkHead, number: int) -> int:
        return head.stored if number in self._verbatim or (self._keeps and self._is_maybe(number)) else head.size

    @cached_property
    def _keeps(self) -> bool:
        """Return whether large messages stay compressed here, by the first of them."""
        some = list(islice(filter(self._is_maybe, self._order), _SAMPLE))
        return self._carriers is not None and all(map(self._carriers.has, some))

    def _is_maybe(self, number: int) -> bool:
        return self._carriers is not None and self._carriers.maybe(number)

    def size_of(self, number: int) -> int:
        """Return about how many bytes a chunk brings into memory."""
        if self._is_maybe(number):
            return self.index.head(number).stored
        return self._loader.size_of(number)

    def take(self) -> Group:
        """Return the next chunks, about as many as are worth a read."""
        if self._order[self._next] in self._verbatim:
            self._next += 1
            return Group(self, [self._order[self._next - 1]], verbatim=True)
        taken, size = [], 0
        while self.more and size < GROUP_BYTES and self._order[self._next] not in self._verbatim:
            number = self._order[self._next]
            taken.append(number)
            size += self.size_of(number)
            self._next += 1
        return Group(self, taken, verbatim=False)

    def load(self, numbers: List[int], pool: Pool) -> List[Block]:
        """Return the messages of chunks.

        Raises:
            BagError: A chunk is damaged.
        """
        blocks: List[Block] = []
        for kind, run in groupby(numbers, key=self._kind):
            blocks += self._loaded(kind, list(run), pool)
        return blocks

    def _kind(self, number: int) -> str:
        if self.index.head(number).compression == "none":
            return "plain"
        return "carrier" if self._carriers and self._carriers.has(number) else "compressed"

    def _loaded(self, kind: str, numbers: List[int], pool: Pool) -> List[Block]:
        if self._carriers and kind == "carrier":
            block = self._carriers.load(numbers, pool)
            if block is not None:
                return [block]
        load = self._loader.plain if kind == "plain" else self._loader.compressed
        return [self._relabelled(load(numbers, pool))]

    def _relabelled(self, block: Block) -> Block:
        connection = self._target[block.table.connection]
        return block._replace(table=relabel(block.buffer, block.table, connection, self._shift_ns))
