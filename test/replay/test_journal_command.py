"""Deciding a journal again: no difference to itself, and a changed rule is found and named."""

from __future__ import annotations

import json
from shutil import copytree

import pytest
from replay_bags import START_NS, S, flight_rows, header, make, write_bag
from replay_runs import CONFIG, ROOT, replay

from amaze_autonomy.bags import Recording
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.engine.events import Event
from amaze_autonomy.journal.journal import DeltaEncoder, JournalError, decode, read
from amaze_autonomy.replay.compare import compare
from amaze_autonomy.replay.errors import JournalGapError, ReplayError
from amaze_autonomy.replay.recordings.journals import read_journals, read_log
from amaze_autonomy.replay.report import comparison_lines
from amaze_autonomy.tester.command import main


@pytest.fixture
def lines(tmp_path, flight_map):
    bag = write_bag(tmp_path / "x.bag", flight_rows(silent={"/mag": (20.0, 21.0)}))
    return replay(bag, flight_map)[0].journal


@pytest.fixture
def journal_file(tmp_path, lines):
    path = tmp_path / "journal.jsonl"
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def entries(lines, start=0, at=None):
    return [
        (
            (at or (START_NS + index * 1_000_000)),
            "/autonomy/journal",
            make(
                "amaze_autonomy/msg/JournalEntry",
                header=header(START_NS),
                sequence=index,
                kind=json.loads(line).get("kind", "event"),
                line=line,
            ),
        )
        for index, line in enumerate(lines)
        if index >= start
    ]


CHANGED = ("sensors.components.magnetometer.wait_limit_s=0.8",)
SET = [word for change in CHANGED for word in ("--set", change)]


def test_a_journal_decided_again_by_its_own_rules_is_the_same(lines):
    comparison = compare(read("\n".join(lines) + "\n"))
    decisions = sum('"kind":"decision"' in line for line in lines)
    assert (comparison.differences, comparison.first, comparison.truncated) == (0, None, False)
    assert (comparison.decisions, comparison.events) == (decisions, len(lines) - 1 - decisions)


def test_a_changed_rule_is_found_and_named_with_the_first_different_decision(lines):
    comparison = compare(read("\n".join(lines) + "\n"), load_configuration(CONFIG, CHANGED).rules)
    assert comparison_lines(comparison) == [
        f"{comparison.events} events decided again, 17 decisions in the journal: {comparison.differences} differences.",
        f"First difference at +20.421 s, line {comparison.first.event_line}, WatchdogAction:",
        "  recorded  decision 9, rule failure_wait",
        "            state     MISSION -> MISSION/flying",
        "            value     failure magnetometer",
        "            value     code 4",
        "            value     action wait",
        "            value     waits at most 10 s",
        "            value     reason no message on /mag for longer than 0.5 s",
        "  decided   decision 9, rule failure_wait",
        "            state     MISSION -> MISSION/flying",
        "            value     failure magnetometer",
        "            value     code 4",
        "            value     action wait",
        "            value     waits at most 0.8 s",
        "            value     reason no message on /mag for longer than 0.5 s",
        "  differs in: values",
    ]


def test_the_page_shows_what_is_printed(lines):
    journal = read("\n".join(lines) + "\n")
    page = (ROOT / "docs" / "replay.md").read_text()
    for change in (*CHANGED, "sensors.landing_detection.ground_distance_m=0.12"):
        printed = iter(comparison_lines(compare(journal, load_configuration(CONFIG, [change]).rules)))
        shown = page.split(f"$ amaze-replay journal journal.jsonl --set {change}\n")[1].partition("```")[0].splitlines()
        wanted = [line for line in shown if line.strip() != "..." and not line.startswith("VACUOUS")]
        assert [line for line in wanted if line not in printed] == []  # in this order


def test_a_journal_without_an_event_is_no_success(tmp_path, lines, capsys):
    path = tmp_path / "journal.jsonl"
    path.write_text(f"{lines[0]}\n")
    assert main(["journal", str(path)]) == 3
    assert "There is no event in the journal: nothing was compared.\n" in capsys.readouterr().out


def test_a_changed_limit_is_found_with_value_and_limit(lines):
    rules = load_configuration(CONFIG, ["autonomy.takeoff.takeoff_height_m=1.4"]).rules
    comparison = compare(read("\n".join(lines) + "\n"), rules)
    first = comparison.first
    assert (first.recorded.rule, first.recorded.before, first.recorded.after) == (
        "at_takeoff_height",
        "TAKEOFF",
        "MISSION",
    )
    assert first.decided is None
    assert "            value     height" in comparison_lines(comparison)[4]
    assert comparison_lines(comparison)[4].endswith("m, limit 1 m")


@pytest.mark.parametrize(
    "change",
    [
        lambda lines: lines[:20] + [line for line in lines[20:] if '"rule":"hold"' not in line],
        lambda lines: [line.replace('"rule":"hold"', '"rule":"land"') for line in lines],
        lambda lines: [line for line in lines for _ in range(2 if '"rule":"hold"' in line else 1)],
    ],
    ids=["a decision is missing", "a decision is another", "a decision is there twice"],
)
def test_a_journal_that_was_changed_is_found(lines, change):
    comparison = compare(read("\n".join(change(list(lines))) + "\n"))
    assert comparison.differences == 1


def test_a_journal_whose_last_line_was_cut_off_is_compared_as_far_as_it_goes(lines):
    comparison = compare(read("\n".join(lines)[:-30]))
    assert (comparison.differences, comparison.truncated) == (0, True)


def test_a_journal_that_was_cut_between_an_event_and_its_decisions_is_cut_off(lines):
    last = max(number for number, line in enumerate(lines) if '"kind":"decision"' in line)
    first = max(number for number in range(last) if '"kind":"event"' in lines[number]) + 1
    cut = read("\n".join(lines[:first]) + "\n")
    comparison = compare(cut)
    assert (comparison.differences, comparison.truncated) == (0, True)
    other = load_configuration(CONFIG).rules  # what other rules decide there is a difference
    assert (compare(cut, other).differences, compare(cut, other).truncated) == (last + 1 - first, False)


def test_a_journal_without_rules_is_refused():
    with pytest.raises(JournalError, match="no rules here"):
        compare(read('{"kind":"header","version":1}\n'))


def test_exit_status_and_words_of_the_command(journal_file, capsys):
    assert main(["journal", str(journal_file)]) == 0
    assert capsys.readouterr().out.endswith("no difference.\n")
    assert main(["journal", str(journal_file), "--config", str(CONFIG)]) == 0
    assert main(["journal", str(journal_file), *SET]) == 1
    assert "First difference at +" in capsys.readouterr().out
    journal_file.write_bytes(journal_file.read_bytes()[:-25])
    assert main(["journal", str(journal_file)]) == 3
    assert "The journal is cut off" in capsys.readouterr().out
    journal_file.write_text("no journal\n")
    assert main(["journal", str(journal_file)]) == 2
    assert capsys.readouterr().err == (
        f"amaze-replay: {journal_file}: line 1: not JSON: Expecting value: line 1 column 1 (char 0) (truncated or "
        "damaged)\n"
    )


OF_NODES = "a journal holds what the nodes said, so the engine's rules alone decide"
OF_CODES = "the codes in a journal are those that its watchdog gave by the severity of then"
UNREAD = [
    ("sensors.components.magnetometer.topics./px4/magnetometer.rate_hz", "10.0", OF_NODES),
    ("sensors.components.magnetometer.topics./px4/magnetometer.age_limit_s", "5.0", OF_NODES),
    ("sensors.landing_detection.ground_distance_m", "0.12", OF_NODES),
    ("sensors.state_estimation.tilt_limit_deg", "9.0", OF_NODES),
    ("sensors.components.imu.severity", "low", OF_CODES),
    ("autonomy.commands.user_hold_limit_s", "20.0", "no decision asked for it"),
]


@pytest.mark.slow_rows
@pytest.mark.parametrize("key, value, reason", UNREAD, ids=[key for key, _, _ in UNREAD])
def test_a_key_that_a_journal_cannot_look_at_is_named_and_is_the_exit_status(journal_file, capsys, key, value, reason):
    change = ["--set", f"{key}={value}"]
    assert main(["journal", str(journal_file), *change]) == 4
    first, *others = capsys.readouterr().out.splitlines()
    assert first.endswith(": no difference.")
    assert others == [f"VACUOUS: {key} was not looked at: {reason}"]
    assert main(["journal", str(journal_file), "--json", *change]) == 4
    (result,) = json.loads(capsys.readouterr().out)
    assert result["not_looked_at"] == [{"key": key, "reason": reason}]
    assert main(["journal", str(journal_file), *change, *SET]) == 1  # another key makes the difference
    journal_file.write_bytes(journal_file.read_bytes()[:-25])
    assert main(["journal", str(journal_file), *change]) == 3


def test_a_key_that_a_decision_asked_for_is_an_answer(journal_file, capsys):
    assert main(["journal", str(journal_file), "--set", "autonomy.takeoff.lift_off_limit_s=9.5"]) == 0
    assert "VACUOUS" not in capsys.readouterr().out


def test_a_changed_copy_of_the_configuration_is_followed_by_its_keys(tmp_path, journal_file, capsys):
    folder = tmp_path / "config"
    copytree(CONFIG, folder)
    sensors = folder / "sensors.yaml"
    sensors.write_text(sensors.read_text().replace("ground_distance_m: 0.1", "ground_distance_m: 0.12"))
    assert main(["journal", str(journal_file), "--config", str(folder)]) == 4
    words = f"VACUOUS: sensors.landing_detection.ground_distance_m was not looked at: {OF_NODES}"
    assert words in capsys.readouterr().out.splitlines()


def test_what_was_flown_by_is_an_answer_however_it_is_named(tmp_path, flight_map, flight_bag, capsys):
    change = "sensors.landing_detection.ground_distance_m=0.12"
    path = tmp_path / "journal.jsonl"
    path.write_text("".join(f"{line}\n" for line in replay(flight_bag, flight_map, overrides=[change])[0].journal))
    assert main(["journal", str(path), "--set", change]) == 0
    assert "VACUOUS" not in capsys.readouterr().out


def test_a_key_that_was_asked_for_before_the_engine_was_started_again_is_an_answer(tmp_path, lines, capsys):
    path = tmp_path / "journal.jsonl"
    path.write_text("".join(f"{line}\n" for line in (*lines, *lines[:2])))
    assert main(["journal", str(path), "--set", "autonomy.takeoff.lift_off_limit_s=9.5"]) == 0
    assert "VACUOUS" not in capsys.readouterr().out


def test_the_result_as_json(journal_file, capsys):
    assert main(["journal", str(journal_file), "--json", *SET]) == 1
    (result,) = json.loads(capsys.readouterr().out)
    assert result["differences"] > 0
    assert result["first_difference"]["event"] == "WatchdogAction"


def test_a_journal_in_a_bag_is_the_one_on_disk(tmp_path, lines):
    bag = write_bag(tmp_path / "b.bag", entries(lines))
    (journal,) = read_journals(bag)
    assert journal == read("\n".join(lines) + "\n")
    assert main(["journal", str(bag)]) == 0


def test_lines_that_were_sent_twice_or_late_do_no_harm(tmp_path, lines):
    rows = entries(lines)
    again = entries(lines[:40], at=START_NS + 5_000_000)
    bag = write_bag(tmp_path / "b.bag", sorted(rows + again, key=lambda row: row[0]))
    assert read_journals(bag) == (read("\n".join(lines) + "\n"),)


def test_two_runs_of_the_engine_in_one_bag_are_two_journals(tmp_path, lines):
    other = [lines[0].replace('"version":1', '"version":1,"x":1'), *lines[1:30]]
    rows = entries(lines) + [(t + 1000 * S, topic, message) for t, topic, message in entries(other)]
    journals = read_journals(write_bag(tmp_path / "b.bag", rows))
    assert [len(journal.lines) for journal in journals] == [len(lines), 30]


def test_a_journal_whose_beginning_was_not_recorded_is_refused(tmp_path, lines, capsys):
    bag = write_bag(tmp_path / "b.bag", entries(lines, start=7))
    with pytest.raises(
        JournalGapError, match="lines 1 to 7 are missing in the journal, the recording began after the jour"
    ):
        read_journals(bag)
    assert main(["journal", str(bag)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_line_that_was_lost_is_named(tmp_path, lines):
    rows = entries(lines)
    with pytest.raises(JournalGapError, match="line 13 is missing in the journal, messages were lost"):
        read_journals(write_bag(tmp_path / "b.bag", rows[:12] + rows[13:]))


def in_deltas(lines):
    encoder = DeltaEncoder()
    payloads = [decode(line).payload for line in lines]
    return [encoder.encode(each) if isinstance(each, Event) else line for each, line in zip(payloads, lines)]


def test_a_journal_of_delta_lines_in_a_bag_is_the_same(tmp_path, lines):
    short = in_deltas(lines)
    assert sum(line[3] == '"' for line in short) > len(lines) / 2
    rows = entries(short)
    again = entries(short[:40], at=START_NS + 5_000_000)
    (found,) = read_journals(write_bag(tmp_path / "b.bag", sorted(rows + again, key=lambda row: row[0])))
    assert [line.payload for line in found.lines] == [decode(line).payload for line in lines]


def test_what_was_asked_is_read_behind_delta_lines_whose_base_was_not_recorded(tmp_path, lines):
    """A bag that lacks lines still says what a user asked: that stands in full."""
    wanted, found = (
        read_log((recording,), "/autonomy/journal")
        for recording in (
            Recording(write_bag(tmp_path / "whole.bag", entries(lines))),
            Recording(write_bag(tmp_path / "part.bag", entries(in_deltas(lines), start=9))),
        )
    )
    kept = [each.sequence for each in found.decisions]
    assert kept == [each.sequence for each in wanted.decisions][-len(kept) :]
    assert len(kept) > 3
    assert found.end_ns == wanted.end_ns


def test_a_bag_without_a_journal_is_refused(flight_bag, capsys):
    assert main(["journal", str(flight_bag)]) == 2
    assert "has no topic of type amaze_autonomy/JournalEntry; name a bag with a journal" in capsys.readouterr().err


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ReplayError, match=r"nothing\.jsonl: cannot be read \(No such file or directory\)"):
        read_journals(tmp_path / "nothing.jsonl")
