"""What a replay found, as plain values for programs and as lines for people."""

from __future__ import annotations

from typing import Any, Dict, List, Optional, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.state import Result

from ..journal.codec import to_plain
from ..journal.report import limit_words
from .compare import Comparison, Difference, changed_fields
from .plan import Plan
from .recordings.sources import Recordings
from .session import Outcome, not_recorded
from .timeline import Line, value_text, written

_S = 1_000_000_000
_WIDE = 40


def verdict(outcome: Outcome) -> str:
    """Return what came of a replay in one sentence."""
    state, result = outcome.state.state.value, outcome.state.session.result.value
    ends = f"ends in {state}" + (f" ({result})" if result else "") + f" after {len(outcome.decisions)} decisions"
    if outcome.counterfactual_ns is None:
        return f"{ends}."
    time_s = (outcome.counterfactual_ns - outcome.start_ns) / _S
    words = "the flight decided otherwise then"
    if outcome.missed is not None:
        words = f"the recorded vehicle did not do what was commanded then ({outcome.missed.name})"
    return f"{ends}; counterfactual after {time_s:+.3f} s: {words}."


def timeline_text(outcome: Outcome) -> str:
    """Return the timeline as plain text."""
    return "".join(f"{time}  {source:<10}  {text}\n" for time, source, text in _rows(outcome))


def _rows(outcome: Outcome) -> List[Tuple[str, str, str]]:
    return [written(line, outcome.start_ns) for line in outcome.timeline]


def footer_lines(plan: Plan, recordings: Recordings, outcome: Outcome) -> List[str]:
    """Return what stands below the timeline: the recording's figures, the checks, damage, the verdict."""
    length_s = (outcome.end_ns - outcome.start_ns) / _S
    lines = ["", f"Recording: {length_s:.3f} s, {recordings.count} messages of {len(recordings.topics)} topics"]
    for figures in recordings.figures():
        text = f"  {figures.topic:<{_WIDE}} {figures.messages:>7} messages"
        if figures.longest_gap_at_ns is not None:
            rate = f"{'-':>8}   " if figures.rate_hz is None else f"{figures.rate_hz:8.2f} Hz"
            at_s = (figures.longest_gap_at_ns - outcome.start_ns) / _S
            text += f"  {rate}  longest gap {figures.longest_gap_s:.3f} s at {at_s:+.3f} s"
        lines.append(text)
    lines += _damage_lines(recordings, outcome)
    if outcome.checks:
        lines.append("Checks, as answered last:")
    for name, (source, rows) in outcome.checks.items():
        lines.append(f"  {name.value:<{_WIDE}} {source.words}")
        lines += [f"    {row.verdict.value:<8} {row_words(row)}" for row in rows]
    if len(outcome.flights) > 1 or (outcome.flights and outcome.state.session.result is Result.NOT_FLOWN):
        count = f"{len(outcome.flights)} flight{'s' * (len(outcome.flights) > 1)}"
        lines.append(f"{count}; --flight N judges one by itself, --flights each:")
        lines += [f"  {n}, armed {each.words(outcome.start_ns)}" for n, each in enumerate(outcome.flights, 1)]
    if outcome.scripted:
        lines.append(f"Scripted all along: {', '.join(outcome.scripted)}.")
    lines += [f"{not_recorded(*each)}." for each in outcome.unseen.items()]
    if plan.contents:
        lines.append(f"Judged by the rate alone: {', '.join(plan.contents)}; no content or stamp is read here.")
    lines += _compared_lines(outcome) + _flown_lines(outcome)
    lines += [f"VACUOUS: {each}" for each in outcome.unread]
    return [*lines, f"Map {plan.topic_map.name}, mission {outcome.mission.id}: {verdict(outcome)}"]


def _compared_lines(outcome: Outcome) -> List[str]:
    """Return whether what the recorded nodes said is what the recorded sensors say."""
    if not outcome.compared:
        return []
    nodes = " and ".join(node.replace("_", " ") for node in outcome.compared)
    if not outcome.disagreements:
        return [f"The recorded {nodes} said what the recorded sensors say."]
    return [f"The recorded {nodes} said otherwise than the recorded sensors:"] + [
        f"  {each.about}, {(each.from_ns - outcome.start_ns) / _S:+.3f} s to "
        f"{(each.to_ns - outcome.start_ns) / _S:+.3f} s: {each.recorded} in flight, {each.judged} by the sensors"
        for each in outcome.disagreements
    ]


def _flown_lines(outcome: Outcome) -> List[str]:
    """Return whether the decisions are those of the flight: states and rules in their order, not times and values."""
    if outcome.flown is None:
        return []
    parting = outcome.parting
    if parting is None:
        same = min(len(outcome.flown), len(outcome.decisions))
        ends = "" if same == len(outcome.decisions) else "; there its journal ends"
        if outcome.flown_in_part:
            ends = "; those after the first lost line of its journal were not compared"
        return [f"In flight the same {same} decisions were made, in the same order{ends}."]
    sides = f"there {_short(parting.flown)}, here {_short(parting.decided)}"
    return [f"Decision {parting.number} is not that of the flight: {sides}."]


def _short(decision: Optional[Decision]) -> str:
    return "none" if decision is None else f"{decision.before} -> {decision.after} by {decision.rule}"


def row_words(row: Any) -> str:
    """Return a row of a check as it is listed."""
    value = "" if row.value is None else f" {row.value:.4g} {row.unit}"
    limits = limit_words(row, lambda each: f"{each:.4g} {row.unit}".rstrip())
    advice = f"  ({row.advice})" if row.advice else ""
    return f"{row.name}{value.rstrip()}{f', limit {limits}' if limits else ''}{advice}"


def _damage_lines(recordings: Recordings, outcome: Outcome) -> List[str]:
    return [f"DAMAGED: {problem}" for problem in recordings.problems] + [
        f"DAMAGED: {each.count} messages of {each.topic} from {(each.first_ns - outcome.start_ns) / _S:+.3f} s to "
        f"{(each.last_ns - outcome.start_ns) / _S:+.3f} s could not be read ({each.reason}); they count as arrived, "
        "what they said is unknown"
        for each in recordings.damage.values()
    ]


def replay_result(plan: Plan, recordings: Recordings, outcome: Outcome) -> Dict[str, Any]:
    """Return all of it as JSON values; the same for the same recording."""
    missed = outcome.missed.name if outcome.missed is not None else None
    return {
        "bags": [bag.path.name for bag in recordings.bags],
        "map": plan.topic_map.name,
        "mission": outcome.mission.id,
        "configuration_hash": plan.configuration_hash,
        "verdict": verdict(outcome),
        "state": outcome.state.state.value,
        "result": outcome.state.session.result.value,
        "decisions": len(outcome.decisions),
        "as_flown": _as_flown(outcome),
        "start_ns": outcome.start_ns - recordings.shift_ns,
        "end_ns": outcome.end_ns - recordings.shift_ns,
        "begins": _begins(outcome),
        "scripted": list(outcome.scripted),
        "flights": [
            {"armed_s": _seconds(each.armed_ns, outcome), "disarmed_s": _seconds(each.disarmed_ns, outcome)}
            for each in outcome.flights
        ],
        "counterfactual_from_s": _seconds(outcome.counterfactual_ns, outcome),
        "missed_command": missed,
        "topics": [_topic(figures, outcome) for figures in recordings.figures()],
        "problems": list(recordings.problems),
        "damage": [_damage(each, outcome) for each in recordings.damage.values()],
        "checks": [
            {"check": name.value, "source": source.words, "rows": [to_plain(row) for row in rows]}
            for name, (source, rows) in outcome.checks.items()
        ],
        "not_looked_at": [{"key": each.key, "reason": each.reason} for each in outcome.unread],
        "compared": list(outcome.compared),
        "disagreements": [
            {
                "about": each.about,
                "from_s": _seconds(each.from_ns, outcome),
                "to_s": _seconds(each.to_ns, outcome),
                "recorded": each.recorded,
                "judged": each.judged,
            }
            for each in outcome.disagreements
        ],
        "timeline": [_line(line, outcome) for line in outcome.timeline],
    }


def _as_flown(outcome: Outcome) -> Optional[bool]:
    """Return whether all decisions are those of the flight; None: it is not known."""
    if outcome.flown is None or (outcome.flown_in_part and outcome.parting is None):
        return None
    return outcome.parting is None


def _begins(outcome: Outcome) -> Optional[Dict[str, Any]]:
    first = outcome.beginning
    if first is None:
        return None
    return {"airborne": first.airborne, "height_m": first.height_m, "reason": first.reason}


def _topic(figures: Any, outcome: Outcome) -> Dict[str, Any]:
    return {
        "topic": figures.topic,
        "messages": figures.messages,
        "rate_hz": figures.rate_hz,
        "longest_gap_s": figures.longest_gap_s,
        "longest_gap_at_s": _seconds(figures.longest_gap_at_ns, outcome),
    }


def _damage(damage: Any, outcome: Outcome) -> Dict[str, Any]:
    return {
        "topic": damage.topic,
        "messages": damage.count,
        "from_s": _seconds(damage.first_ns, outcome),
        "to_s": _seconds(damage.last_ns, outcome),
        "reason": damage.reason,
    }


def _line(line: Line, outcome: Outcome) -> Dict[str, Any]:
    return {
        "t_s": _seconds(line.t_ns, outcome),
        "source": line.source.words,
        "kind": line.kind.value,
        "text": line.text,
        "level": line.level,
        "times": line.times,
        "scripted": line.scripted,
        "counterfactual": line.counterfactual,
    }


def _seconds(t_ns: Optional[int], outcome: Outcome) -> Optional[float]:
    return None if t_ns is None else (t_ns - outcome.start_ns) / _S


# --- journals ---------------------------------------------------------------------------------------------------------


def comparison_lines(comparison: Comparison) -> List[str]:
    """Return what came of deciding a journal again, for people."""
    counts = f"{comparison.events} events decided again, {comparison.decisions} decisions in the journal"
    lines = [f"{counts}: {_count(comparison.differences)}."]
    if not comparison.events:
        lines.append("There is no event in the journal: nothing was compared.")
    if comparison.truncated:
        lines.append("The journal is cut off (the process was killed), or its last event is decided otherwise now.")
    if comparison.first is not None:
        lines += _difference_lines(comparison.first, comparison.start_ns)
    return lines + [f"VACUOUS: {each}" for each in comparison.unread]


def _count(differences: int) -> str:
    return {0: "no difference", 1: "1 difference"}.get(differences, f"{differences} differences")


def _difference_lines(difference: Difference, start_ns: int) -> List[str]:
    event = difference.event
    time_s = (event.t_ns - start_ns) / _S
    lines = [f"First difference at {time_s:+.3f} s, line {difference.event_line}, {type(event).__name__}:"]
    recorded, decided = difference.recorded, difference.decided
    lines += _side("recorded", recorded, start_ns) + _side("decided", decided, start_ns)
    if recorded is not None and decided is not None:
        lines.append(f"  differs in: {', '.join(changed_fields(recorded, decided))}")
    return lines


def _side(name: str, decision: Optional[Decision], start_ns: int) -> List[str]:
    if decision is None:
        return [f"  {name:<9} nothing"]
    step = f"/{decision.step}" if decision.step else ""
    lines = [f"  {name:<9} decision {decision.sequence}, rule {decision.rule}"]
    lines.append(f"            state     {decision.before} -> {decision.after}{step}")
    lines += [f"            value     {value_text(value, start_ns)}" for value in decision.values]
    lines += [f"            command   {command}" for command in decision.commands]
    return lines


def comparison_result(comparison: Comparison) -> Dict[str, Any]:
    """Return it as JSON values."""
    first = comparison.first
    return {
        "events": comparison.events,
        "decisions": comparison.decisions,
        "differences": comparison.differences,
        "truncated": comparison.truncated,
        "state": comparison.final.state.value,
        "not_looked_at": [{"key": each.key, "reason": each.reason} for each in comparison.unread],
        "first_difference": None
        if first is None
        else {
            "line": first.event_line,
            "event": type(first.event).__name__,
            "t_ns": first.event.t_ns,
            "t_s": (first.event.t_ns - comparison.start_ns) / _S,
            "recorded": None if first.recorded is None else to_plain(first.recorded),
            "decided": None if first.decided is None else to_plain(first.decided),
        },
    }
