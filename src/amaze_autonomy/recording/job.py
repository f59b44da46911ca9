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
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Counter, Dict, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import UNDECODABLE
from amaze_autonomy.bags.index import Index
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
from amaze_autonomy.files import sha256_of
from amaze_autonomy.units import MB, SECOND

from .collector import Offset, clock_step_ns, moment
from .errors import RecordingError
from .losses import EDGE_NS, Loss, Wanted, losses, not_configured
from .parts import Part, check_arrived, close_parts, recover_damaged, whole_bags
from .storage import recording_of

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
        begun: how often the session was: as often its clock was to be measured.
        clock: what was measured of it, for the manifest.
        wanted: its groups by the configuration of the collector.
    """

    platform: str
    folder: Path
    fetched: bool = False
    far: bool = False
    correction_ns: int = 0
    begun: int = 1
    clock: Mapping[str, Any] = {}
    wanted: Mapping[str, Any] = {}


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
    """Make the complete recording, or find that it is there; what a damaged bag lacks is lost, and told.

    Raises:
        BagError: A bag cannot be used, or the output not be written.
        RecordingError: A part did not arrive as it was sent, or the result is not what it should be.
    """
    tried: Set[str] = set()
    plan = plan._replace(facts=_known(plan.facts))
    while True:
        try:
            return _collected(plan, report)
        except BagError as error:
            if error.path in tried or not _recovered(plan, Path(error.path), report):
                raise
            tried.add(error.path)


def _recovered(plan: Plan, bag: Path, report: Optional[Report]) -> bool:
    """Recover a bag that could not be used; return whether there is another one for it now."""
    progress = _as_progress(report, Phase.MERGING)
    return any(
        recover_damaged(source.folder, bag, plan.output.parent / source.platform, progress) for source in plan.sources
    )


def _collected(plan: Plan, report: Optional[Report]) -> Summary:
    """Make the complete recording of what there is, or find that it is there."""
    inputs = _inputs(plan)
    output, beside = _output(plan.output, inputs.paths)
    plan = plan._replace(output=output, facts={**plan.facts, **inputs.facts, "beside": list(beside)})
    manifest = _made(plan, inputs, report)
    return _summary(plan, manifest, inputs.lost)._replace(beside=beside)


def _made(plan: Plan, inputs: _Inputs, report: Optional[Report]) -> Dict[str, Any]:
    """Return the manifest of the verified recording: of the one that is here, or of one that is made now."""
    before = _usable_manifest(plan, inputs)
    if before is not None:
        with suppress(BagError, RecordingError):  # then it was damaged since, and its parts may be whole
            return _verified(plan, inputs, before, report)
    _check_unchanged(plan.output, inputs)
    return _verified(plan, inputs, _merged(plan, inputs, report), report)


def _output(path: Path, inputs: Sequence[Path]) -> Tuple[Path, Tuple[str, ...]]:
    """Return where the recording of some bags is to lie, and the names of those that stay beside it.

    One that is there is written over only where all that it was made of is still here: parts that were removed after
    they were verified (`keep_parts: false`) are nowhere else. One that was verified has to be in the new one, too.
    """
    beside: List[str] = []
    output = path
    while output.exists() and not _can_be_made_again(output, inputs):
        beside.append(output.name)
        output = path.with_name(f"{path.stem}-{len(beside) + 1}{path.suffix}")
    return output, tuple(beside)


def _can_be_made_again(output: Path, inputs: Sequence[Path]) -> bool:
    """Return whether all parts of a recording are here, and among some bags, themselves or what was recovered of them.

    Of one that was not verified they need not be among them. One without a manifest was not finished, or somebody has
    lost it: then they have to have all of its messages.
    """
    if not manifest_path(output).exists():
        return _has_no_more(output, inputs)
    try:
        manifest = read_manifest(manifest_path(output))
        there = [(output.parent / str(each["file"]), each["bytes"]) for each in manifest["inputs"]]
        verified = bool((manifest["verified"] or {}).get("ok"))
    except (BagError, KeyError, TypeError, AttributeError):
        return False
    here = all(path.is_file() and path.stat().st_size == size for path, size in there)
    return here and not (verified and {_recording(path) for path, _ in there} - set(map(_recording, inputs)))


def _has_no_more(output: Path, inputs: Sequence[Path]) -> bool:
    """Return whether a bag has, of no topic, more messages than some bags together."""
    try:
        rest = _counts(output)
        for path in inputs:
            rest.subtract(_counts(path))
    except BagError:
        return False
    return all(count <= 0 for count in rest.values())


def _counts(bag: Path) -> Counter[str]:
    """Return how many messages of each topic the index of a bag names."""
    counts: Counter[str] = Counter()
    with Index(bag) as index:
        for chunk in index.chunks:
            for connection, count in chunk.counts:
                counts[index.connections[connection].topic] += count
    return counts


def _recording(bag: Path) -> Tuple[str, str]:
    """Return the platform of a bag and what its recorder wrote: what is recovered from it may lie in another folder."""
    return bag.resolve().parent.name, recording_of(bag.name)


class _Inputs(NamedTuple):
    """What the recording is made of.

    Args:
        paths: of all bags.
        offsets_ns: the correction of each.
        origins: the platform of each, by its place in the plan.
        unchecked: the sha256 that files had when they were closed, of those that were not looked at again since, or
            that were found to be otherwise.
        recovered: files that had to be recovered after they were listed, and lost something.
        platforms: what the manifest says of each.
        lost: by all of them.
    """

    paths: List[Path]
    offsets_ns: List[int]
    origins: List[int]
    unchecked: Dict[Path, str]
    recovered: List[Path]
    platforms: Dict[str, Any]
    lost: List[Loss]

    @property
    def facts(self) -> Dict[str, Any]:
        """Return what the manifest says of them."""
        lost, in_flight = [each.words for each in self.lost], [each.words for each in self.lost if each.counts]
        return {"platforms": self.platforms, "lost": lost, "lost_in_flight": in_flight}


def _inputs(plan: Plan) -> _Inputs:
    """Return what there is of all platforms, and what was lost.

    Raises:
        BagError: A bag cannot be recovered.
        RecordingError: A part did not arrive as it was sent, or there is no bag at all.
    """
    lost = [Loss(f"{name}: its part, nothing of this session is there") for name in plan.facts.get("absent", ())]
    lost += _set_back(plan.facts)
    lost += [_taken_out(name, location) for name, location in plan.facts.get("taken_out", {}).items()]
    found = _Inputs([], [], [], {}, [], {}, lost + _began_late(plan.facts) + _ended_early(plan.facts))
    for origin, source in enumerate(plan.sources):
        content = check_arrived(source.folder, checksums=source.fetched)
        parts = whole_bags(source.folder, content, plan.output.parent / source.platform)
        wanted = _wanted(plan, source, content)
        gone = _stepped(source) + _lost_here(content, parts, wanted)
        lacking = not_configured(content, source.wanted, wanted.tolerated)
        found.paths.extend(part.path for part in parts)
        found.offsets_ns.extend([source.correction_ns] * len(parts))
        found.origins.extend([origin] * len(parts))
        for each in content["files"]:
            if each.get("unreadable"):
                continue
            if each.get("changed") or not source.fetched:
                found.unchecked[source.folder / str(each["file"])] = each.get("changed") or each["sha256"]
            if each.get("listed_as") and each.get("lost") != 0:
                found.recovered.append(source.folder / str(each.get("recovered_from")))
        found.lost.extend(each._replace(words=f"{source.platform}/{each.words}") for each in gone)
        found.lost.extend(each._replace(words=f"{source.platform}: {each.words}") for each in lacking)
        found.platforms[source.platform] = {
            "clock": dict(source.clock),
            "correction_ns": source.correction_ns,
            "gaps": content.get("gaps", []),
            "dropped_warnings": content.get("dropped", 0),
            "missing_numbers": content.get("missing", {}),
            "uncounted_topics": content.get("uncounted", []),
            "lost": [each.words for each in (*gone, *lacking)],
        }
    if not found.paths:
        raise RecordingError(f"{plan.output}: there is no bag on any platform, nothing was recorded; look at the logs")
    found.lost.extend(_undecodable(found.paths, plan.facts))
    return found


def _undecodable(paths: Sequence[Path], facts: Mapping[str, Any]) -> List[Loss]:
    """Return the topics whose messages are there and cannot be decoded: no bag has an undamaged definition of them."""
    damaged: Dict[Tuple[str, str], Set[str]] = {}
    defined: Set[Tuple[str, str]] = set()
    for path in paths:
        with Index(path) as index:
            used = {number for chunk in index.chunks for number, _ in chunk.counts}
            for number, each in index.connections.items():
                if each.is_damaged and number in used:
                    damaged.setdefault((each.kind, each.md5), set()).add(each.topic)
                elif each.definition and not each.is_damaged:
                    defined.add((each.kind, each.md5))
    topics = {topic for what, found in damaged.items() if what not in defined for topic in found}
    tolerated = facts.get("tolerated_topics", ())
    return [Loss(f"{topic}: {UNDECODABLE}", topic not in tolerated) for topic in sorted(topics)]


def _known(facts: Mapping[str, Any]) -> Dict[str, Any]:
    """Return the facts, without times of the flight where the clock that says them was set back meanwhile."""
    ended = [(begin, end) for begin, end in facts.get("flights") or () if end is not None]
    back_ns = max([int(facts.get("set_back_ns", 0)), *(begin - end for begin, end in ended)])
    return {**facts, "set_back_ns": back_ns, "flights": None, "stopped_ns": None} if back_ns > 0 else dict(facts)


def _set_back(facts: Mapping[str, Any]) -> List[Loss]:
    """Return that the collector's clock was set back: nobody can tell of a time by it whether it was in the flight."""
    back_ns = facts.get("set_back_ns", 0)
    words = (
        f"the collector's clock was set back by {back_ns / SECOND:,.1f} s or more during the recording: its record "
        "times are left as they are, and do not tell what was lost in the flight"
    )
    return [Loss(words)] if back_ns else []


def _taken_out(name: str, location: str) -> Loss:
    """Return the part of a platform that was taken out of the configuration before its part was here."""
    lies = f" (it lies there at {location}, and amaze-bag merge joins it)" if location else ""
    return Loss(f"{name}: its part, recording.yaml has no such platform any more{lies}")


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
    """Return what was to be recorded on a platform, on its clock; where that is not known, nobody knows when.

    While a clock drifts, the flight lasts from its takeoff by the least to its landing by the greatest offset, so that
    what may lie in it counts. One that was not measured at the beginning and at the end may have been stepped.
    """
    if (source.far and not source.clock) or _stepped(source):
        return Wanted(tolerated=frozenset(plan.facts.get("tolerated_topics", ())), topics=content.get("topics", {}))
    stopped_ns, flights = plan.facts.get("stopped_ns"), plan.facts.get("flights")
    offsets = [int(each["offset_ns"]) for each in source.clock.values()] or [0]
    least_ns, most_ns = min(offsets), max(offsets)
    return Wanted(
        end_ns=None if stopped_ns is None else int(stopped_ns) + most_ns,
        flights=None
        if flights is None
        else tuple((begin and begin + least_ns, None if end is None else end + most_ns) for begin, end in flights),
        tolerated=frozenset(plan.facts.get("tolerated_topics", ())),
        topics=content.get("topics", {}),
        sure=not source.far or {"start", moment("stop", source.begun)} <= set(source.clock),
    )


def _stepped(source: Source) -> List[Loss]:
    """Return that the offsets of a clock contradict each other; nobody knows which of the two was stepped, and when.

    It counts, though every message may be there: of a group that was begun after the takeoff or ended before the
    landing nobody can tell.
    """
    step_ns = clock_step_ns([Offset(**each) for each in source.clock.values()])
    words = (
        f"its clock, or the collector's, was stepped by {step_ns / SECOND:,.1f} s during the recording: its record "
        "times are left as they are, and do not tell what was lost in the flight"
    )
    return [Loss(words)] if step_ns else []


def _lost_here(content: Mapping[str, Any], parts: Sequence[Part], wanted: Wanted) -> List[Loss]:
    """Return the losses of a part, with what was lost in bags that were recovered here."""
    here = {part.file: part for part in parts}
    files = [told for entry in content["files"] for told in _told(entry, here.get(str(entry["file"])))]
    return losses({**content, "files": files}, wanted)


def _told(entry: Mapping[str, Any], part: Optional[Part]) -> List[Mapping[str, Any]]:
    """Return what the list says of a file, with what was lost of it here; None: nothing of it could be read."""
    file = entry["file"]
    if part is None:
        return [{"file": file, "lost": None, "unreadable": True}] if entry["bytes"] else []
    if entry.get("open"):
        return [{**entry, **part.losses}]
    return [entry] if part.path.name == file else [entry, {"file": file, **part.losses}]


def _usable_manifest(plan: Plan, inputs: _Inputs) -> Optional[Dict[str, Any]]:
    """Return the manifest of just this merge that was finished before, and not found wrong; None: there is none."""
    output = plan.output
    if not output.is_file():
        return None
    try:
        manifest = read_manifest(manifest_path(output))
        made = [  # an earlier version compared files, not platforms, and says nothing of it
            (str(each["file"]), each["bytes"], each["offset_ns"], each.get("origin", place))
            for place, each in enumerate(manifest["inputs"])
        ]
        as_asked = manifest["duplicates"]["what"] == plan.duplicates and (manifest["verified"] or {}).get("ok", True)
    except (BagError, KeyError, TypeError, AttributeError):
        return None
    files = ((_relative(path, output.parent), path.stat().st_size) for path in inputs.paths)
    now = [(*file, *how) for file, *how in zip(files, inputs.offsets_ns, inputs.origins)]
    same = manifest["output"].get("bytes") == output.stat().st_size
    return manifest if as_asked and same and made == now else None


def _check_unchanged(output: Path, inputs: _Inputs) -> None:
    """See to it that what is written over can be made again: its parts are what they were when they were closed.

    Or they are what it was verified to be made of: of parts that had changed before, it never had more.

    Raises:
        RecordingError: One is not; the recording that is there may be the only copy of what it was.
    """
    if not output.exists():
        return
    used, verified = _used(output)
    found = {path: sha256_of(path) for path in inputs.unchecked}
    made_of = used if verified else {}
    changed = [
        path for path, first in inputs.unchecked.items() if found[path] not in (first, made_of.get(path.resolve()))
    ]
    changed += [path for path in inputs.recovered if path.resolve() in used]
    if changed:
        names = " and ".join(map(str, changed))
        raise RecordingError(
            f"{output}: is not made again, as it may have what its parts lack: {names} is not what was recorded any "
            "more; both are kept"
        )


def _used(output: Path) -> Tuple[Dict[Path, str], bool]:
    """Return the sha256 of each file that a recording was made of, by its manifest, and whether that was verified."""
    try:
        manifest = read_manifest(manifest_path(output))
        used = {(output.parent / str(each["file"])).resolve(): str(each["sha256"]) for each in manifest["inputs"]}
        return used, bool((manifest["verified"] or {}).get("ok"))
    except (BagError, KeyError, TypeError, AttributeError):
        return {}, False


def _relative(path: Path, folder: Path) -> str:
    return os.path.relpath(path.resolve(), folder.resolve())


def _merged(plan: Plan, inputs: _Inputs, report: Optional[Report]) -> Dict[str, Any]:
    options = MergeOptions(
        offsets_ns=tuple(inputs.offsets_ns),
        duplicates=plan.duplicates,
        origins=tuple(inputs.origins),
        replace=True,
        check_copied=True,  # who finds damage only in what was made cannot tell any more whose it is
    )
    merged = merge(inputs.paths, plan.output, options, _as_progress(report, Phase.MERGING))
    manifest = merge_manifest(merged, inputs.paths, options)
    write_manifest(manifest_path(plan.output), manifest)
    return manifest


def _verified(plan: Plan, inputs: _Inputs, manifest: Dict[str, Any], report: Optional[Report]) -> Dict[str, Any]:
    """Verify the recording; write and return its manifest, with the facts and the verdict."""
    manifest = {**manifest, **plan.facts}
    try:
        verified = verify(
            plan.output,
            inputs.paths,
            offsets_ns=inputs.offsets_ns,
            duplicates=declared_duplicates(manifest),
            progress=_as_progress(report, Phase.VERIFYING),
        )
    except BagError as error:  # an earlier verdict holds no longer
        verdict = {"ok": False, "problems": [str(error)], "readers": {}}
        write_manifest(manifest_path(plan.output), {**manifest, "verified": verdict})
        raise
    if report is not None:
        report(Phase.VERIFYING, 1, 1)
    manifest = verified_manifest(manifest, verified, inputs.offsets_ns)
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
    return {"problem": "", "files": len(content["files"]), "foreign": content.get("foreign", [])}


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
