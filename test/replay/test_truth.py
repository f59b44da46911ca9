"""What the tester says of the known recordings is what an independent reading of them says.

truth.yaml was written down from independent_reading.py, which shares no code with ours. Each fact of it is compared
with our own, as the command line comes to it: by the shipped map, through the whole replay. Where ours says something
else on purpose, the table says what and why (`ours`). `python test/replay/test_truth.py` prints the table of
docs/replay.md, which is made of both.
"""

from __future__ import annotations

import functools
import re
from pathlib import Path

import our_reading
import pymavlink
import pytest
import yaml
from independent_reading import plain
from independent_reading import read as independently
from our_reading import changes, replayed, second
from packaging.version import Version
from replay_runs import ROOT, recording

from amaze_autonomy.replay.errors import NoMessagesError
from amaze_autonomy.replay.maps.proposal import propose

pytestmark = [pytest.mark.xdist_group("truth"), pytest.mark.long]  # each recording is replayed once
TRUTH = yaml.safe_load((Path(__file__).parent / "truth.yaml").read_text())
WARNING = 4
FULL = [name for name, facts in TRUTH.items() if "counts" in facts]
MODES = {  # pymavlink's word to ours, which is that of PX4; an ArduCopter's mode has the name of what it does
    **{name: f"AUTO.{name}" for name in ("LOITER", "MISSION", "TAKEOFF", "LAND", "RTL")},
    "STABILIZE": "STABILIZED",
    "AUTO": "AUTO.MISSION",
    "OFFBOARD": "OFFBOARD",
    "POSCTL": "POSCTL",
}
FIX_3D = 3
ID_NAMES = {"UNKNOWN_410": "EVENT"}  # which pymavlink reads in another dialect only


# --- what they must agree in ------------------------------------------------------------------------------------------


def three(true):
    """Return the last, the lowest and the highest value: the first of a log is ours only after its first heartbeat."""
    return [true["last"], true["lowest"][1], true["highest"][1]]


def texts(true):
    """Return by text how often it was said, whether it is a warning (1) or worse, and when first and last."""
    rows = {text: [(t, severity) for t, severity, other in true if other == text] for _, _, text in true}
    return {
        text: [len(each), 1 if each[0][1] == WARNING else 2, each[0][0], each[-1][0]] for text, each in rows.items()
    }


def modes(true):
    """Return modes in our words: LOITER is flown by the sticks on an ArduCopter, and by PX4 itself."""
    copter = any(word == "STABILIZE" for _, word in true)
    return changes([t, "POSCTL" if copter and word == "LOITER" else MODES[word]] for t, word in true)


EARLY_LATE = (0.5, 5.0)  # the landing detection wants the vehicle to stay on the ground before it says so
S, EXACT = 0.1, 0
# fact: (what of the true one is compared, ours, tolerances of a row's columns)
FACTS = {
    "begins_us": (lambda true: true, lambda replay: replay.outcome.start_ns // 1000, EXACT),
    "length_s": (lambda true: true, lambda replay: (replay.outcome.end_ns - replay.outcome.start_ns) / 1e9, S),
    "bad_frames": (lambda true: true, our_reading.frames, EXACT),
    "gaps": (lambda true: {name: [t for t, _ in rows] for name, rows in true.items()}, our_reading.silences, S),
    "armed": (changes, lambda replay: changes((t, each.armed) for t, each in replay.statuses), (S, EXACT)),
    "mode": (modes, lambda replay: changes((t, each.mode) for t, each in replay.statuses), (S, EXACT)),
    "landed": (
        changes,
        lambda replay: changes(((t, our_reading.LANDED[each.landed]) for t, each in replay.statuses), ("unknown",)),
        (S, EXACT),
    ),
    "flights": (lambda true: true, our_reading.flights, (S, S, 0.5, EARLY_LATE, S)),
    "in_the_air": (lambda true: true, our_reading.airborne, (0.5, EARLY_LATE)),
    "in_the_air_by_range": (lambda true: true, our_reading.airborne, (0.5, EARLY_LATE)),
    "gps_fix": (lambda true: changes([t, fix >= FIX_3D] for t, fix in true), our_reading.gps, (S, EXACT)),
    "voltage_v": (three, lambda replay: our_reading.extremes(replay, "battery_voltage_v"), 0.01),
    "remaining_percent": (three, lambda replay: our_reading.extremes(replay, "battery_fraction", 100.0), 1.01),
    "height_m": (lambda true: true["highest"][1], lambda replay: our_reading.extremes(replay, "height_m")[2], S),
    "warnings": (texts, our_reading.warnings, (EXACT, EXACT, S, S)),
    "impacts_m_s2": (
        lambda true: true,
        lambda replay: our_reading.lines(replay, r"impact: acceleration up to ([\d.]+)"),
        (S, S),
    ),
    "free_falls": (
        lambda true: true,
        lambda replay: our_reading.lines(replay, r"free fall for ([\d.]+) s: acceleration down to ([\d.]+)"),
        (S, 0.05, S),
    ),
    "largest_tilt_deg": (lambda true: true, our_reading.largest_tilt, (S, S)),
}
NOT_SAID = {  # facts that ours has no line for
    "nav_sat_status": "of NavSatFix only the rate is watched",
    "range_m": "the landing detection says of a range what it means",
}
ALWAYS = ("gaps", "impacts_m_s2", "free_falls", "warnings")  # none of it is a fact as well


def agree(true, said, tolerance):
    """Return True when two values are the same, numbers within tolerances."""
    if isinstance(true, dict):
        return true.keys() == said.keys() and all(agree(true[key], said[key], tolerance) for key in true)
    if isinstance(true, list):
        nested = isinstance(tolerance, tuple) and not any(isinstance(each, list) for each in true)
        within = tolerance if nested else [tolerance] * len(true)
        return len(true) == len(said) and all(map(agree, true, said, within))
    if isinstance(true, float) or tolerance:
        early, late = tolerance if isinstance(tolerance, tuple) else (tolerance, tolerance)
        return true is said or (None not in (true, said) and -early <= said - true <= late)
    return true == said


@functools.lru_cache(maxsize=None)
def compared(name):
    """Return the facts of a recording that ours can tell: fact, what is expected of ours, ours, tolerance."""
    truth, replay, rows = TRUTH[name], replayed(name), []
    for fact, (part, ours, tolerance) in FACTS.items():
        if fact in truth or fact in ALWAYS:
            true = truth.get(fact, {} if fact == "gaps" else [])
            exception = truth.get("ours", {}).get(fact)
            rows.append((fact, exception["says"] if exception else part(true), ours(replay), tolerance))
    return rows


@pytest.mark.slow_rows
@pytest.mark.parametrize("name", FULL)
def test_ours_says_what_is_true(name):
    wrong = [(fact, true, ours) for fact, true, ours, tolerance in compared(name) if not agree(true, ours, tolerance)]
    assert wrong == []


@pytest.mark.parametrize("name", FULL)
@pytest.mark.slow_rows
def test_every_message_is_counted(name):
    true, ours = TRUTH[name]["counts"], our_reading.counts(replayed(name))
    named = {word: ours.pop(ID_NAMES.get(word, word)) for word in true if ID_NAMES.get(word, word) in ours}
    assert (named, ours) == ({word: true[word] for word in named}, {})
    assert sum(number for word, number in true.items() if word not in named) == our_reading.strangers(replayed(name))


@pytest.mark.parametrize("name", [name for name in FULL if "gaps" in TRUTH[name]])
def test_the_longest_gap_of_a_topic_is_among_its_figures(name):
    replay = replayed(name)
    expected = {topic: max(rows, key=second) for topic, rows in TRUTH[name]["gaps"].items() if rows}
    ours = {
        each.topic.replace("/mavlink/", ""): [
            (each.longest_gap_at_ns - replay.outcome.start_ns) / 1e9,
            each.longest_gap_s,
        ]
        for each in replay.figures
    }
    late = {topic for topic in expected if topic in ours and ours[topic][0] == 0.0}  # silent first
    said = {topic: ours[topic] for topic in expected if topic in ours and topic not in late}
    assert agree({topic: expected[topic] for topic in said}, said, (0.02, 0.02))
    assert len(said) + len(late) >= len(expected) - 1  # no map watches SYS_STATUS of a copter


@pytest.mark.parametrize("name", FULL)
def test_no_fact_is_left_out(name):
    elsewhere = {"counts", "ours"}
    assert set(TRUTH[name]) - set(FACTS) - elsewhere <= set(NOT_SAID)


def test_a_recording_without_messages_is_one():
    assert TRUTH["no_messages.bag"] == {"messages": 0}
    with pytest.raises(NoMessagesError):
        propose([recording("no_messages.bag")])


names_as_the_table = pytest.mark.skipif(
    Version(pymavlink.__version__) < Version("2.4.50"),
    reason=f"pymavlink {pymavlink.__version__} names messages and modes otherwise; the table is of 2.4.50",
)


@pytest.mark.parametrize("name", ["crazyflie_sine.bag", pytest.param("px4_offboard.tlog", marks=names_as_the_table)])
def test_the_table_is_what_the_independent_reading_prints(name):
    facts = {fact: value for fact, value in TRUTH[name].items() if fact != "ours"}
    assert plain(independently(recording(name))) == facts


def test_the_independent_reading_shares_no_code_with_ours():
    source = (Path(__file__).parent / "independent_reading.py").read_text()
    roots = {name.split(".")[0] for name in re.findall(r"^ *(?:from|import) (\S+)", source, re.MULTILINE)}
    assert roots == {"__future__", "os", "sys", "collections", "pathlib", "numpy", "yaml", "pymavlink", "rosbags"}


# --- the table of docs/replay.md --------------------------------------------------------------------------------------


def _flights(rows):
    return "; ".join(
        f"armed {armed:.1f} to {disarmed:.1f} s, "
        + ("stays down" if up is None else f"up {up:.1f} s, down {down:.1f} s, {highest:.1f} m")
        for armed, disarmed, up, down, highest in rows
    )


def _times(times):
    return " ".join(f"{t:.1f} s" for t in times)


WORDS = {
    "flights": _flights,
    "in_the_air": lambda rows: f"in the air {rows[0][0]:.1f} to {rows[0][1]:.1f} s",
    "in_the_air_by_range": lambda rows: f"in the air {rows[0][0]:.1f} to {rows[0][1]:.1f} s",
    "mode": lambda rows: "modes " + ", ".join(f"{mode or 'unknown'} {t:.1f} s" for t, mode in rows),
    "gps_fix": lambda rows: "GPS " + ", ".join(f"{'good' if good else 'not'} {t:.1f} s" for t, good in rows),
    "gaps": lambda rows: "silent: " + ", ".join(f"{name} {_times(rows[name])}" for name in sorted(rows)),
    "voltage_v": lambda values: f"down to {values[1]:.2f} V",
    "armed": lambda rows: ""
    if rows[-1][1] is not None
    else "armed unknown " + _times(t for t, word in rows if word is None),
    "warnings": lambda rows: f"{sum(row[0] for row in rows.values())} texts that warn",
    "impacts_m_s2": lambda rows: ", ".join(f"impact of {worst:.1f} m/s^2 at {t:.1f} s" for t, worst in rows),
    "free_falls": lambda rows: ", ".join(f"free fall of {length:.2f} s at {t:.1f} s" for t, length, _ in rows),
    "largest_tilt_deg": lambda row: f"largest tilt {row[1]:.0f} deg at {row[0]:.1f} s",
}


def table():
    """Return what docs/replay.md shows: what is true, what ours says of it in other numbers, and why."""
    rows = ["| Recording | What is true | What ours says otherwise |", "|---|---|---|"]
    for name in FULL:
        truth, true_words, our_words = TRUTH[name], [f"{sum(TRUTH[name]['counts'].values()):,} messages"], []
        for fact, _, ours, _ in compared(name):
            true = FACTS[fact][0](truth[fact]) if fact in truth else {}
            words = [WORDS[fact](value) if fact in WORDS and value else "" for value in (true, ours)]
            why = truth.get("ours", {}).get(fact, {}).get("why", "")
            true_words += [words[0]] if words[0] else []
            if words[0] != words[1] or why:
                our_words.append((words[1] or f"no {fact.replace('_', ' ')}") + (f" ({why})" if why else ""))
        rows.append(f"| `{name}` | {'; '.join(true_words)} | {'; '.join(our_words) or 'nothing'} |")
    return "\n".join(rows)


def test_the_documentation_shows_it():
    """`python test/replay/test_truth.py` prints the table."""
    assert all(recording(name) for name in FULL)
    assert table() in (ROOT / "docs" / "replay.md").read_text()


if __name__ == "__main__":
    print(table())
