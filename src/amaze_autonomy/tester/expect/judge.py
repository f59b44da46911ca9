"""Judges one expectation on one run. Nothing evaluated is VACUOUS, never a pass."""

from __future__ import annotations

from typing import Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Tuple

from ...journal.trace import Span, Trace
from .model import Expectation, Finding, Grade, Moment, Pattern, instants, moments, spans, unseen

_NS = 1e9
_ROUNDED_NS = 1_000_000_000  # who writes a time down rounds it
_DURATIONS = ("at_least_s", "at_most_s")
_WORST = (Grade.FAIL, Grade.VACUOUS, Grade.PASS)


class Window(NamedTuple):
    """The time that an expectation looks at, both ends included; `asked_ns`: where it was to end."""

    begin_ns: int
    end_ns: int
    asked_ns: int

    def holds(self, t_ns: int) -> bool:
        """Tell whether a time is in it."""
        return self.begin_ns <= t_ns <= self.end_ns


class _Look(NamedTuple):
    """What a judgement needs."""

    expectation: Expectation
    trace: Trace
    window: Window

    def number(self, key: str) -> Optional[float]:
        return self.expectation.number(key)

    def found(self, key: str) -> List[int]:
        return [moment.t_ns for moment in self.moments(key)]

    def moments(self, key: str) -> List[Moment]:
        found = moments(self.expectation.pattern(key), self.trace)
        return [moment for moment in found if self.window.holds(moment.t_ns)]

    def lasting(self, pattern: Pattern) -> List[Span]:
        """Return the spans of a condition, cut to the window; those that do not touch it are left out."""
        begin, end = self.window.begin_ns, self.window.end_ns
        cut = (Span(max(s.begin_ns, begin), min(s.end_ns, end), s.value) for s in spans(pattern, self.trace))
        return [span for span in cut if span.end_ns > span.begin_ns]

    def cuts(self, span: Span) -> str:
        """Say where a span was cut by the window: what begins or ends just there has begun or ended there."""
        whole = spans(self.expectation.pattern("of"), self.trace)
        uncut = next(each for each in whole if each.begin_ns <= span.begin_ns and span.end_ns <= each.end_ns)
        before = ", and had begun before" if uncut.begin_ns < span.begin_ns else ""
        return before + (f", and had not ended at {self.time(span.end_ns)}" if span.end_ns < uncut.end_ns else "")

    def time(self, t_ns: int) -> str:
        return f"{self.trace.seconds(t_ns):+.3f} s"


class _Found(NamedTuple):
    """A finding without its frame."""

    grade: Grade
    text: str
    margin: Optional[float] = None
    limit: Optional[float] = None
    unit: str = ""


def judge(expectation: Expectation, trace: Trace, anchors: Mapping[str, Optional[int]]) -> Finding:
    """Judge an expectation.

    Args:
        expectation: of the scenario.
        trace: of the run.
        anchors: time of each anchor; None: it did not happen.
    """
    window = _window(expectation, trace, anchors)
    if isinstance(window, str):
        return _finding(expectation, trace, None, _Found(Grade.VACUOUS, window))
    blind = [words for words in (unseen(pattern, trace) for _, pattern in expectation.patterns) if words]
    if blind:
        return _finding(expectation, trace, window, _Found(Grade.VACUOUS, blind[0]))
    found = _JUDGES[expectation.kind.name](_Look(expectation, trace, window))
    if found.grade is Grade.PASS and window.asked_ns > trace.end_ns + _ROUNDED_NS and _may_break(expectation):
        there = f"and the run ends there, before {trace.seconds(window.asked_ns):+.3f} s"
        found = _Found(Grade.VACUOUS, f"{found.text}, {there}")
    return _finding(expectation, trace, window, found)


def _may_break(expectation: Expectation) -> bool:
    """Tell whether what holds until the end of the run could still break after it."""
    kind = expectation.kind.name
    return kind in ("never", "always", "share") or (kind == "count" and expectation.number("at_most") is not None)


def _window(expectation: Expectation, trace: Trace, anchors: Mapping[str, Optional[int]]) -> Window | str:
    times: List[int] = []
    ends = (expectation.begin, trace.end_ns - trace.start_ns if expectation.end is None else expectation.end)
    if isinstance(ends[0], int) and 0 < ends[0] < trace.begin_ns - trace.start_ns - _ROUNDED_NS:
        return f"nothing to look at: the run begins at {trace.seconds(trace.begin_ns):+.3f} s"
    for instant in ends:
        t_ns = anchors[instant] if isinstance(instant, str) else trace.start_ns + instant
        if t_ns is None:
            return f"nothing to look at: {instant} did not happen"
        times.append(t_ns if isinstance(instant, str) else max(t_ns, trace.begin_ns))
    if times[1] <= times[0] or times[0] > trace.end_ns:
        return "nothing to look at: the window is empty"
    return Window(times[0], min(times[1], trace.end_ns), times[1])


def _finding(expectation: Expectation, trace: Trace, window: Optional[Window], found: _Found) -> Finding:
    return Finding(
        expectation=str(expectation),
        grade=found.grade,
        text=found.text,
        margin=None if found.margin is None else round(found.margin, 9),
        limit=found.limit,
        unit=found.unit,
        begin_s=None if window is None else trace.seconds(window.begin_ns),
        end_s=None if window is None else trace.seconds(window.end_ns),
        where=expectation.where,
    )


def _exists(look: _Look) -> _Found:
    pattern, within_s = look.expectation.pattern("of"), look.number("within_s")
    times = look.found("of")
    if pattern.lasts and any(span.begin_ns == look.window.begin_ns for span in look.lasting(pattern)):
        times = [look.window.begin_ns, *times]
    if not times:
        return _Found(Grade.FAIL, f"{pattern} does not happen between {_ends(look)}")
    if within_s is None:
        return _Found(Grade.PASS, f"at {look.time(times[0])}")
    took_s = (times[0] - look.window.begin_ns) / _NS
    text = f"at {look.time(times[0])}, {took_s:.3f} s after"
    return _limited(text, within_s - took_s, within_s, "s")


def _never(look: _Look) -> _Found:
    pattern = look.expectation.pattern("of")
    times = look.found("of")
    if pattern.lasts:
        times = sorted({*times, *(span.begin_ns for span in look.lasting(pattern))})
    if times:
        return _Found(Grade.FAIL, f"{pattern} at {look.time(times[0])}" + _more(times))
    return _Found(Grade.PASS, f"not between {_ends(look)}")


def _always(look: _Look) -> _Found:
    pattern = look.expectation.pattern("of")
    reached_ns = look.window.begin_ns
    for span in look.lasting(pattern):
        if span.begin_ns > reached_ns:
            break
        reached_ns = span.end_ns
    if reached_ns < look.window.end_ns:
        return _Found(Grade.FAIL, f"not {pattern} at {look.time(reached_ns)}")
    return _Found(Grade.PASS, f"between {_ends(look)}")


def _response(look: _Look) -> _Found:
    limit_s = look.number("within_s") or 0.0
    triggers = look.found("when")
    if not triggers:
        return _Found(Grade.VACUOUS, f"{look.expectation.pattern('when')} does not happen between {_ends(look)}")
    answers = instants(look.expectation.pattern("then"), look.trace)
    worst: Optional[Tuple[float, str]] = None
    for t_ns in triggers:
        answer = next((a for a in answers if a >= t_ns), None)
        if answer is None:
            then = look.expectation.pattern("then")
            return _Found(Grade.FAIL, f"no {then} after {look.time(t_ns)}, {_times(triggers)}")
        took_s = (answer - t_ns) / _NS
        if worst is None or took_s > worst[0]:
            worst = (took_s, f"{took_s:.3f} s after {look.time(t_ns)}, the slowest of {len(triggers)}")
    took_s, text = worst or (0.0, "")
    return _limited(text, limit_s - took_s, limit_s, "s")


def _precedence(look: _Look) -> _Found:
    then = look.moments("then")
    if not then:
        return _Found(Grade.VACUOUS, f"{look.expectation.pattern('then')} does not happen between {_ends(look)}")
    first = look.moments("first")
    if not first or first[0] > then[0]:
        return _Found(Grade.FAIL, f"{look.expectation.pattern('then')} at {look.time(then[0].t_ns)} came first")
    begin_ns, end_ns = first[0].t_ns, then[0].t_ns
    return _Found(Grade.PASS, f"{look.time(begin_ns)} before {look.time(end_ns)}", (end_ns - begin_ns) / _NS, None, "s")


def _sequence(look: _Look) -> _Found:
    reached = Moment(look.window.begin_ns)
    used: List[Tuple[Pattern, Moment]] = []
    for _, pattern in look.expectation.patterns:
        seen = moments(pattern, look.trace)
        options = [m for m in seen if m >= reached and m.t_ns <= look.window.end_ns and (pattern, m) not in used]
        moment = _next(pattern, look, options, len(used))
        if moment is None:
            return _Found(Grade.FAIL, f"no {pattern} after {look.time(reached.t_ns)}, step {len(used) + 1}")
        reached = moment
        used.append((pattern, moment))
    within_s = look.number("within_s")
    took_s = (reached.t_ns - look.window.begin_ns) / _NS
    text = f"{len(used)} in order until {look.time(reached.t_ns)}"
    return _Found(Grade.PASS, text) if within_s is None else _limited(text, within_s - took_s, within_s, "s")


def _next(pattern: Pattern, look: _Look, options: Iterable[Moment], number: int) -> Optional[Moment]:
    """Return the first moment of a step; the first step may have begun before the window."""
    begin_ns = look.window.begin_ns
    if number == 0 and pattern.lasts and any(s.begin_ns < begin_ns < s.end_ns for s in spans(pattern, look.trace)):
        return Moment(begin_ns)
    return next(iter(options), None)


def _count(look: _Look) -> _Found:
    times = len(look.found("of"))
    return _bounded(look, float(times), ("at_least", "at_most"), "", f"{times} times between {_ends(look)}")


def _duration(look: _Look) -> _Found:
    found = look.lasting(look.expectation.pattern("of"))
    if not found:
        return _Found(Grade.VACUOUS, f"{look.expectation.pattern('of')} does not happen between {_ends(look)}")
    results = [_length(look, span) for span in found]
    return min(results, key=lambda found: (_WORST.index(found.grade), found.margin or 0.0))


def _length(look: _Look, span: Span) -> _Found:
    """Judge how long one span is; of one that was cut by the window only the least is known."""
    length = (span.end_ns - span.begin_ns) / _NS
    found = _bounded(look, length, _DURATIONS, "s", f"{length:.3f} s from {look.time(span.begin_ns)}")
    cuts = look.cuts(span)
    if found.grade is Grade.FAIL or look.number(_DURATIONS[1]) is None or not cuts:
        return found
    return _Found(Grade.VACUOUS, found.text + cuts)


def _share(look: _Look) -> _Found:
    total = look.window.end_ns - look.window.begin_ns
    part = sum(span.end_ns - span.begin_ns for span in look.lasting(look.expectation.pattern("of"))) / total
    return _bounded(
        look, part, ("at_least_fraction", "at_most_fraction"), "", f"{part:.3f} of the time between {_ends(look)}"
    )


def _limited(text: str, margin: float, limit: float, unit: str) -> _Found:
    grade = Grade.PASS if margin >= 0.0 else Grade.FAIL
    return _Found(grade, text, margin, limit, unit)


def _bounded(look: _Look, value: float, keys: Tuple[str, str], unit: str, text: str) -> _Found:
    """Compare a value with the bounds that were given; the margin is that to the nearer one."""
    least, most = look.number(keys[0]), look.number(keys[1])
    sides: List[Tuple[float, float]] = []
    if least is not None:
        sides.append((value - least, least))
    if most is not None:
        sides.append((most - value, most))
    margin, limit = min(sides)
    return _limited(text, margin, limit, unit)


def _ends(look: _Look) -> str:
    return f"{look.time(look.window.begin_ns)} and {look.time(look.window.end_ns)}"


def _more(times: List[int]) -> str:
    return f" and {len(times) - 1} more times" if len(times) > 1 else ""


def _times(triggers: List[int]) -> str:
    return f"{len(triggers)} times looked at"


_JUDGES: Dict[str, Callable[[_Look], _Found]] = {
    "exists": _exists,
    "never": _never,
    "always": _always,
    "response": _response,
    "precedence": _precedence,
    "sequence": _sequence,
    "count": _count,
    "duration": _duration,
    "share": _share,
}
