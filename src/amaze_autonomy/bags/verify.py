"""Is a merged bag what it should be: every message of its inputs once, in order of time, readable by everybody."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple

from .count import Counted, count
from .readers import Reading, disagreements, read_with
from .tally import Tallies, Tally, TopicKey

__all__ = ["Verified", "verify"]

Progress = Callable[[int, int], None]


class Verified(NamedTuple):
    """What was found.

    Args:
        output: what the merged bag has.
        inputs: what its inputs have.
        duplicates: messages that were declared as dropped.
        readings: what other readers say.
        problems: one line each; none when all is well.
    """

    output: Counted
    inputs: Tuple[Counted, ...]
    duplicates: Dict[TopicKey, Tally]
    readings: Tuple[Reading, ...]
    problems: Tuple[str, ...]


def verify(
    output: Path,
    inputs: Sequence[Path],
    *,
    offsets_ns: Sequence[int] = (),
    duplicates: Optional[Dict[TopicKey, Tally]] = None,
    readers: str = "open",
    progress: Optional[Progress] = None,
) -> Verified:
    """Compare a merged bag with its inputs, message by message.

    Args:
        output: the merged bag.
        inputs: what it was merged from; none to verify the bag alone.
        offsets_ns: that were added to the record times of each input.
        duplicates: messages that were dropped because another input has them.
        readers: none, open (they read the index) or read (they read every message).
        progress: called with bytes done and all bytes.

    Raises:
        BagError: A bag is damaged.
    """
    shifts = [0, *(offsets_ns or [0] * len(inputs))]
    paths = [output, *inputs]
    report = _together(paths, progress)
    with ThreadPoolExecutor(2) as pool:
        counted = list(pool.map(count, paths, shifts, report))
    readings = read_with(output, every_message=readers == "read") if readers != "none" else []
    problems = disagreements(counted[0], readings)
    if not counted[0].ordered:
        problems.insert(0, "its messages are not in order of time")
    if inputs:
        problems = [*_differences(counted[0], counted[1:], duplicates or {}), *problems]
    return Verified(counted[0], tuple(counted[1:]), duplicates or {}, tuple(readings), tuple(problems))


def _together(paths: Sequence[Path], progress: Optional[Progress]) -> List[Optional[Progress]]:
    """Return a progress function for each bag that reports the sum of all."""
    if progress is None:
        return [None] * len(paths)
    done, total = dict.fromkeys(range(len(paths)), 0), sum(path.stat().st_size for path in paths if path.is_file())
    show = progress

    def reporter(place: int) -> Progress:
        def report(bytes_done: int, _: int) -> None:
            done[place] = bytes_done
            show(sum(done.values()), total)

        return report

    return [reporter(place) for place in range(len(paths))]


def _differences(output: Counted, inputs: Sequence[Counted], duplicates: Dict[TopicKey, Tally]) -> List[str]:
    expected = Tallies()
    for counted in inputs:
        for key, tally in counted.topics.items():
            expected.add(key, tally)
    for key, tally in duplicates.items():
        expected.by_topic[key] = expected.by_topic.get(key, Tally()).minus(tally)
    problems = []
    for key in sorted({*expected.by_topic, *output.topics}):
        wanted, found = expected.by_topic.get(key, Tally()), output.topics.get(key, Tally())
        if wanted.messages != found.messages:
            problems.append(f"{key[0]} ({key[1]}) has {found.messages:,} messages instead of {wanted.messages:,}")
        elif wanted != found:
            problems.append(f"{key[0]} ({key[1]}) has messages with other bytes or times than its inputs")
    return problems
