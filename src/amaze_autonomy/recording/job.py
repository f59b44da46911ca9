"""The process that reads and writes bags for a recorder's node: so the node stays small, and answers at once.

It reads one line of JSON from its standard input, which says what to do, and writes lines of JSON: progress, and in the
end the result. It ends when its standard input does, because then nobody waits for it any more. It can be killed at any
moment; the next one goes on: one verified recording of all parts, with its manifest, and what is done already is not
done again.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.merge.manifest import (
    declared_duplicates,
    manifest_path,
    merge_manifest,
    read_manifest,
    verified_manifest,
    write_manifest,
)
from amaze_autonomy.bags.merge.merge import MergeOptions, merge
from amaze_autonomy.bags.merge.verify import verify
from amaze_autonomy.engine.events import RecordingPhase as Phase
from amaze_autonomy.units import MB, SECOND

from .errors import RecordingError
from .losses import EDGE_NS, Loss, Wanted, losses
from .parts import Part, check_arrived, close_parts, whole_bags

# --- one verified recording -------------------------------------------------------------------------------------------


Report = Callable[[Phase, int, int], None]


class Source(NamedTuple):
    """The part of one platform.

    Args:
        platform: its name.
        folder: where it lies on this computer.
        fetched: it came over the network, so its checksums are looked at.
        far: it was recorded on another computer, whose clock is another one.
        correction_ns: added to its record times.
        clock: what was measured of its clock, for the manifest.
    """

    platform: str
    folder: Path
    fetched: bool = False
    far: bool = False
    correction_ns: int = 0
    clock: Mapping[str, Any] = {}


class Plan(NamedTuple):
    """What is to be made.

    Args:
        output: path of the complete recording.
        sources: of it.
        duplicates: count, drop or ignore.
        facts: for the manifest.
    """

    output: Path
    sources: Tuple[Source, ...]
    duplicates: str = "count"
    facts: Mapping[str, Any] = {}


class Summary(NamedTuple):
    """What was made: where, how big, how long; what was lost on the way, and what of that the flight lacks.

    `beside` are verified recordings of this session that were made before, of parts that are not here any more.
    """

    location: str
    size: int
    messages: int
    seconds: float
    platforms: Tuple[str, ...]
    lost: Tuple[str, ...]
    lost_in_flight: Tuple[str, ...] = ()
    beside: Tuple[str, ...] = ()

    @property
    def message(self) -> str:
        """Return it as one line."""
        lost = "lost: " + "; ".join(self.lost) if self.lost else "nothing was lost"
        lost = f"{lost}; nothing of the flight, or it is tolerated" if self.lost and not self.lost_in_flight else lost
        names = " and ".join(self.platforms)
        what = f"{self.size / MB:,.1f} MB, {self.seconds:.1f} s, {self.messages:,} messages of {names}"
        before = f"; what was recorded before is in {' and '.join(self.beside)}" if self.beside else ""
        return f"{what}, verified; {lost}{before}"


def collect(plan: Plan, report: Optional[Report] = None) -> Summary:
    """Make the complete recording, or find that it is there.

    Raises:
        BagError: A bag cannot be used, or the output not be written.
        RecordingError: A part did not arrive as it was sent, or the result is not what it should be.
    """
    inputs, offsets, platforms, lost = _inputs(plan)
    output, beside = _output(plan.output)
    plan = plan._replace(output=output)
    manifest = _usable_manifest(plan.output, inputs, offsets)
    if manifest is None:
        manifest = _merged(plan, inputs, offsets, report)
    manifest.update({**plan.facts, "platforms": platforms, "lost": [each.words for each in lost]})
    manifest["lost_in_flight"] = [each.words for each in lost if each.counts]
    manifest["beside"] = list(beside)
    manifest = _verified(plan, inputs, offsets, manifest, report)
    return _summary(plan, manifest, lost)._replace(beside=beside)


def _output(path: Path) -> Tuple[Path, Tuple[str, ...]]:
    """Return where the recording is to lie, and the names of those that stay beside it.

    One that is there is written over only where all that it was made of is still here: parts that were removed after
    they were verified (`keep_parts: false`) are nowhere else.
    """
    beside: List[str] = []
    output = path
    while output.exists() and not _can_be_made_again(output):
        beside.append(output.name)
        output = path.with_name(f"{path.stem}-{len(beside) + 1}{path.suffix}")
    return output, tuple(beside)


def _can_be_made_again(output: Path) -> bool:
    """Return whether all parts of a recording are here; one without a manifest was not finished, so they are."""
    if not manifest_path(output).exists():
        return True
    try:
        inputs = read_manifest(manifest_path(output))["inputs"]
        there = [(output.parent / str(each["file"]), each["bytes"]) for each in inputs]
    except (BagError, KeyError, TypeError):
        return False
    return all(path.is_file() and path.stat().st_size == size for path, size in there)


def _inputs(plan: Plan) -> Tuple[List[Path], Tuple[int, ...], Dict[str, Any], List[Loss]]:
    """Return all bags, the correction of each, what the manifest says of the platforms, and what was lost."""
    inputs: List[Path] = []
    offsets: List[int] = []
    platforms: Dict[str, Any] = {}
    lost = [Loss(f"{name}: its part, nothing of this session is there") for name in plan.facts.get("absent", ())]
    lost += _began_late(plan.facts) + _ended_early(plan.facts)
    for source in plan.sources:
        content = check_arrived(source.folder, checksums=source.fetched)
        parts = whole_bags(source.folder, content, plan.output.parent / source.platform)
        gone = _lost_here(content, parts, _wanted(plan, source, content))
        inputs += [part.path for part in parts]
        offsets += [source.correction_ns] * len(parts)
        lost += [each._replace(words=f"{source.platform}/{each.words}") for each in gone]
        platforms[source.platform] = {
            "clock": dict(source.clock),
            "correction_ns": source.correction_ns,
            "gaps": content.get("gaps", []),
            "dropped_warnings": content.get("dropped", 0),
            "missing_numbers": content.get("missing", {}),
            "uncounted_topics": content.get("uncounted", []),
            "lost": [each.words for each in gone],
        }
    if not inputs:
        raise RecordingError(f"{plan.output}: there is no bag on any platform, nothing was recorded; look at the logs")
    return inputs, tuple(offsets), platforms, lost


def _began_late(facts: Mapping[str, Any]) -> List[Loss]:
    """Return the beginning of a flight that was under way when the collector first heard of it."""
    flights = facts.get("flights") or ()
    if not flights or flights[0][0]:
        return []
    return [Loss("the beginning of the flight, perhaps: the recording was begun in flight")]


def _ended_early(facts: Mapping[str, Any]) -> List[Loss]:
    """Return the end of a flight that the recording did not last for: somebody stopped it before."""
    stopped_ns, flights = facts.get("stopped_ns"), facts.get("flights") or ()
    if stopped_ns is None or not flights:
        return []
    landed_ns = flights[-1][1]
    if landed_ns is None:
        return [Loss("the end of the flight: the recording was ended before the engine said that it was over")]
    missing_ns = int(landed_ns) - int(stopped_ns)
    if missing_ns <= EDGE_NS:
        return []
    return [Loss(f"the last {missing_ns / SECOND:.1f} s of the flight: the recording was ended before")]


def _wanted(plan: Plan, source: Source, content: Mapping[str, Any]) -> Wanted:
    """Return what was to be recorded on a platform, on its clock; where that was never measured, nobody knows when."""
    if source.far and not source.clock:
        return Wanted(tolerated=frozenset(plan.facts.get("tolerated_topics", ())), topics=content.get("topics", {}))
    stopped_ns, flights = plan.facts.get("stopped_ns"), plan.facts.get("flights")
    offsets = [int(each["offset_ns"]) for each in source.clock.values()]
    shift_ns = sum(offsets) // len(offsets) if offsets else 0
    return Wanted(
        end_ns=None if stopped_ns is None else int(stopped_ns) + shift_ns,
        flights=None
        if flights is None
        else tuple((begin and begin + shift_ns, None if end is None else end + shift_ns) for begin, end in flights),
        tolerated=frozenset(plan.facts.get("tolerated_topics", ())),
        topics=content.get("topics", {}),
    )


def _lost_here(content: Mapping[str, Any], parts: Sequence[Part], wanted: Wanted) -> List[Loss]:
    """Return the losses of a part, with what was lost in bags that were recovered here."""
    known = {part.path.name.split(".")[0]: part.lost for part in parts}
    files = [
        {**entry, "lost": known.get(str(entry["file"]).split(".")[0])} if entry.get("open") else entry
        for entry in content["files"]
    ]
    return losses({**content, "files": files}, wanted)


def _usable_manifest(output: Path, inputs: Sequence[Path], offsets: Sequence[int]) -> Optional[Dict[str, Any]]:
    """Return the manifest of a merge of just these inputs that was finished before; None when there is none."""
    if not output.is_file():
        return None
    try:
        manifest = read_manifest(manifest_path(output))
        made = [(str(each["file"]), each["bytes"], each["offset_ns"]) for each in manifest["inputs"]]
    except (BagError, KeyError, TypeError):
        return None
    now = [(_relative(path, output.parent), path.stat().st_size, offset) for path, offset in zip(inputs, offsets)]
    same = manifest["output"].get("bytes") == output.stat().st_size
    return manifest if same and made == now else None


def _relative(path: Path, folder: Path) -> str:
    return os.path.relpath(path.resolve(), folder.resolve())


def _merged(plan: Plan, inputs: Sequence[Path], offsets: Tuple[int, ...], report: Optional[Report]) -> Dict[str, Any]:
    options = MergeOptions(offsets_ns=offsets, duplicates=plan.duplicates, replace=True)
    merged = merge(inputs, plan.output, options, _as_progress(report, Phase.MERGING))
    manifest = merge_manifest(merged, inputs, options)
    write_manifest(manifest_path(plan.output), manifest)
    return manifest


def _verified(
    plan: Plan, inputs: Sequence[Path], offsets: Tuple[int, ...], manifest: Dict[str, Any], report: Optional[Report]
) -> Dict[str, Any]:
    verified = verify(
        plan.output,
        inputs,
        offsets_ns=offsets,
        duplicates=declared_duplicates(manifest),
        progress=_as_progress(report, Phase.VERIFYING),
    )
    if report is not None:
        report(Phase.VERIFYING, 1, 1)
    manifest = verified_manifest(manifest, verified)
    write_manifest(manifest_path(plan.output), manifest)
    if verified.problems:
        raise RecordingError(f"{plan.output}: {'; '.join(verified.problems)}; the parts are kept, retry merges again")
    return manifest


def _as_progress(report: Optional[Report], phase: Phase) -> Optional[Callable[[int, int], None]]:
    if report is None:
        return None
    tell = report
    tell(phase, 0, 1)
    return lambda done, total: tell(phase, done, total)


def _summary(plan: Plan, manifest: Mapping[str, Any], lost: Sequence[Loss]) -> Summary:
    output = manifest["output"]
    start, end = output["start_ns"], output["end_ns"]
    return Summary(
        location=str(plan.output),
        size=output["bytes"],
        messages=output["messages"],
        seconds=(end - start) / SECOND if start is not None and end is not None else 0.0,
        platforms=tuple(source.platform for source in plan.sources),
        lost=tuple(each.words for each in lost),
        lost_in_flight=tuple(each.words for each in lost if each.counts),
    )


# --- the process ------------------------------------------------------------------------------------------------------


_PERIOD_S = 0.2
_FAILED = 1
_Tell = Callable[[Mapping[str, Any]], None]


class _Meter:
    """Tells progress, not more often than a person can read it."""

    def __init__(self, tell: _Tell) -> None:
        self._tell, self._phase, self._due_s = tell, Phase.IDLE, 0.0

    def __call__(self, phase: Phase, done: int, total: int) -> None:
        now_s = time.monotonic()
        if phase is self._phase and now_s < self._due_s and done < total:
            return
        self._phase, self._due_s = phase, now_s + _PERIOD_S
        self._tell({"phase": phase.name, "progress": done / total if total else 1.0})


def plan_of(request: Mapping[str, Any]) -> Plan:
    """Return the plan that a request holds."""
    return Plan(
        output=Path(request["output"]),
        sources=tuple(Source(**{**each, "folder": Path(each["folder"])}) for each in request["sources"]),
        duplicates=request["duplicates"],
        facts=request["facts"],
    )


def run(request: Mapping[str, Any], tell: _Tell) -> Dict[str, Any]:
    """Do what a request asks; return the result: an empty `problem` when all is well."""
    meter = _Meter(tell)
    try:
        if request["do"] == "collect":
            summary = collect(plan_of(request), meter)
            return {"problem": "", "verified": True, **summary._asdict(), "message": summary.message}
        content = close_parts(
            Path(request["folder"]), request["facts"], lambda done, total: meter(Phase.RECOVERING, done, total)
        )
    except (BagError, RecordingError) as error:
        return {"problem": str(error)}
    except OSError as error:
        return {"problem": f"{error.filename or 'the storage'}: {error.strerror}; make space or repair it, then retry"}
    return {"problem": "", "files": len(content["files"])}


def _end_with_parent() -> None:
    while os.read(0, 4096):  # not the buffered reader, whose lock would be held at the end of the process
        pass
    os._exit(_FAILED)


def main() -> int:
    """Run one job; return 0 when it was done."""
    request = json.loads(sys.stdin.buffer.readline())
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def tell(line: Mapping[str, Any]) -> None:
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()

    result = run(request, tell)
    tell({"result": result})
    return _FAILED if result["problem"] else 0


if __name__ == "__main__":
    sys.exit(main())
