"""`amaze-replay test` and `accept` as their users meet them."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from replay_bags import ROOT

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.tester import Result, Verdict, cli
from amaze_autonomy.tester.command import main
from amaze_autonomy.tester.difference import waveform
from amaze_autonomy.tester.task import result_lines

REASON = "--reason=the first run, and it is right"


@pytest.fixture
def accepted(folder):
    assert main(["accept", str(folder), REASON]) == 0
    return folder


def edit(folder, old, new):
    path = folder / "lrf.scenario.yaml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def verdict(capsys):
    return capsys.readouterr().out.split()[0]


def test_a_missing_golden_fails_and_says_what_to_do(folder, capsys):
    assert main(["test", str(folder)]) == 1
    assert (
        "there is no golden (lrf.golden.jsonl); look at the run, then: amaze-replay accept" in capsys.readouterr().out
    )


def test_an_accepted_run_passes_with_its_margin(accepted, capsys):
    capsys.readouterr()
    assert main(["test", str(accepted)]) == 0
    assert capsys.readouterr().out.splitlines()[0] == (
        "PASS         lrf: 16 decisions, 1 expectations hold; closest 0.4 s of 0.4 s left: "
        "response when lrf at code 8 or above, then command HOLD, within_s 0.4"
    )


def test_another_decision_fails_with_the_first_difference(accepted, capsys):
    edit(accepted, "delay_s: 5.0", "delay_s: 5.5")
    capsys.readouterr()
    assert main(["test", str(accepted)]) == 1
    out = capsys.readouterr().out
    assert out.startswith("FAIL         lrf: decision at ")
    for part in (
        "golden   +",
        "new      +",
        "waits at most (restart limit) 12 s",
        "states   0 s",
        "reproduce: amaze-replay test suite/lrf",
    ):
        assert part in out


def test_a_fault_that_never_begins_is_vacuous(accepted, capsys):
    edit(accepted, "event: airborne", "event: pilot")
    capsys.readouterr()
    assert main(["test", str(accepted)]) == 4
    assert "VACUOUS      lrf: lrf killed did nothing: it never began" in capsys.readouterr().out


def test_an_expectation_that_evaluated_nothing_is_vacuous(accepted, capsys):
    edit(accepted, "component: lrf, code: 8", "component: gps, code: 8")
    capsys.readouterr()
    assert main(["test", str(accepted)]) == 4
    assert "VACUOUS      lrf: response when gps at code 8" in capsys.readouterr().out


def test_a_bag_that_is_not_there_is_inconclusive(folder, capsys):
    (folder / "lrf.scenario.yaml").write_text(
        "version: 1\ndescription: x\nbags: [{path: no.bag}]\nmap: crazyflie_sine\n"
    )
    assert main(["test", str(folder)]) == 3
    assert "INCONCLUSIVE lrf: suite/no.bag: is not there" in capsys.readouterr().out


def test_a_mistake_in_a_file_is_an_error_with_its_line_and_the_others_are_run(accepted, capsys):
    (accepted / "bad.scenario.yaml").write_text("version: 1\ndescription: x\nfault: []\n")
    capsys.readouterr()
    assert main(["test", str(accepted), "-j2"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "ERROR        bad: suite/bad.scenario.yaml:3: fault: is an unknown key; did you mean faults?"
    assert lines[-1].startswith("1 PASS, 1 ERROR;")


def test_two_processes_print_what_one_prints(accepted, capsys):
    for name in ("b", "a", "c"):
        (accepted / f"{name}.scenario.yaml").write_text((accepted / "lrf.scenario.yaml").read_text())
    printed = []
    for jobs in ("-j1", "-j3"):
        capsys.readouterr()
        assert main(["test", str(accepted), jobs]) == 1
        printed.append(capsys.readouterr().out.splitlines()[:-1])
    assert printed[0] == printed[1]
    assert [line.split()[1] for line in printed[0] if line.startswith(("PASS", "FAIL"))] == ["a:", "b:", "c:", "lrf:"]


def piped(verb, streams):
    """Run a verb on scenarios of which one fails; `true` reads nothing of it. Return its exit status, as text."""
    command = f'"{sys.executable}" -m amaze_autonomy.tester.command {verb} suite {streams} | true; '
    done = subprocess.run(
        ["bash", "-c", command + 'echo "${PIPESTATUS[0]}"'],
        env={"PYTHONPATH": str(ROOT / "src"), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert "Error" not in done.stderr
    return done.stdout


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("streams", ["", "2>&1"])
@pytest.mark.parametrize("verb", ["coverage", "accept --reason=long_enough"])
def test_a_reader_that_has_enough_changes_no_verdict(folder, verb, streams):
    edit(folder, "then: {command: HOLD}", "then: {command: RESUME}")
    assert piped(verb, streams) == "1\n"


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("streams", ["", "2>&1"])
@pytest.mark.parametrize("verb", ["test", "corpus"])
def test_nor_what_is_written_of_it(folder, verb, streams):
    edit(folder, "then: {command: HOLD}", "then: {command: RESUME}")
    assert piped(f"{verb} --json r.json", streams) == "1\n"
    assert json.loads(Path("r.json").read_text())["tests"][0]["verdict"] == "FAIL"


def test_a_path_without_scenarios_is_wrong_use(folder, capsys):
    assert main(["test", "nothing"]) == 2
    assert main(["test", str(folder), "--tag", "none"]) == 2
    assert "no scenario was chosen" in capsys.readouterr().err


def test_the_result_file_is_an_error_until_the_run_has_ended(accepted, monkeypatch):
    seen = []
    run = cli.run_tasks

    def spying(*given):
        seen.append(json.loads(Path("r.json").read_text())["verdict"])
        return run(*given)

    monkeypatch.setattr(cli, "run_tasks", spying)
    assert main(["test", str(accepted), "--json", "r.json", "--junit", "r.xml", "--markdown", "r.md"]) == 0
    result = json.loads(Path("r.json").read_text())
    assert (seen, result["verdict"], result["tests"][0]["id"]) == (["ERROR"], "PASS", "lrf")
    case = ET.parse("r.xml").getroot().find("testcase")
    pairs = [(each.get("name"), each.get("value")) for each in case.find("properties")]
    assert pairs[:2] == [("requirement", "R-7"), ("tag", "hold")]
    assert pairs[2][1].startswith("0.4 s of 0.4 s left: response")
    assert "| PASS | lrf | 16 | 0.4 s of 0.4 s left |" in Path("r.md").read_text()


REFUSED = {
    ("accept", "suite"): "why are these goldens right now?",
    ("accept", "suite", "--reason", "ok"): "why are these goldens right now?",
    ("accept", "suite/lrf.scenario.yaml", REASON, "--prune"): "give it whole folders",
}


@pytest.mark.parametrize("words", REFUSED)
def test_accept_refuses(folder, words, capsys):
    assert main(list(words)) == 2
    assert REFUSED[words] in capsys.readouterr().err
    assert not (folder / "goldens").exists()


def test_accept_refuses_in_ci(folder, monkeypatch, capsys):
    monkeypatch.setenv("CI", "true")
    assert main(["accept", str(folder), REASON]) == 2
    assert "goldens are not accepted in CI (CI is set)" in capsys.readouterr().err


def test_accept_refuses_while_an_expectation_fails(folder, capsys):
    edit(folder, "then: {command: HOLD}", "then: {command: RESUME}")
    assert main(["accept", str(folder), REASON]) == 1
    assert "lrf: not accepted: FAIL: response" in capsys.readouterr().out
    assert not (folder / "goldens").exists()


def test_accept_shows_the_difference(accepted, capsys):
    edit(accepted, "delay_s: 5.0", "delay_s: 5.5")
    capsys.readouterr()
    assert main(["accept", str(accepted), REASON]) == 0
    out = capsys.readouterr().out
    assert "lrf: decision at " in out
    assert "0 new, 1 replaced, 0 unchanged" in out
    assert main(["test", str(accepted)]) == 0


def test_a_golden_without_a_scenario_fails_a_full_run_and_is_pruned_with_a_reason(accepted, capsys):
    (accepted / "lrf.scenario.yaml").rename(accepted / "range.scenario.yaml")
    assert main(["accept", str(accepted), REASON]) == 0
    assert main(["test", str(accepted / "range.scenario.yaml")]) == 0
    capsys.readouterr()
    assert main(["test", str(accepted)]) == 1
    assert "FAIL         lrf.golden.jsonl: a golden without a scenario" in capsys.readouterr().out
    assert main(["accept", str(accepted), REASON, "--prune"]) == 0
    assert main(["test", str(accepted)]) == 0


def test_without_expectations_and_goldens_nothing_is_judged_and_a_golden_alone_can_be_accepted(folder, capsys):
    path = folder / "lrf.scenario.yaml"
    path.write_text(path.read_text().partition("expectations:")[0])
    assert main(["test", str(folder), "--no-goldens"]) == 4
    words = "VACUOUS      lrf: it has no expectations, and no golden is compared: nothing was judged"
    assert capsys.readouterr().out.startswith(words)
    assert main(["accept", str(folder), REASON]) == 0
    assert main(["test", str(folder)]) == 0


def test_the_command_to_reproduce_can_be_pasted(folder, capsys):
    other = folder / "two words.scenario.yaml"
    (folder / "lrf.scenario.yaml").rename(other)
    assert main(["test", str(other)]) == 1
    assert f"reproduce: amaze-replay test '{other}'" in capsys.readouterr().out


def test_a_damaged_golden_is_replaced_by_accepting_the_run_anew(accepted, capsys):
    path = accepted / "goldens" / "lrf.golden.jsonl"
    whole = path.read_bytes()
    path.write_text("{broken\n")
    assert main(["accept", str(accepted), REASON]) == 0
    assert "lrf: the old golden is damaged, no difference can be shown: " in capsys.readouterr().out
    assert path.read_bytes() == whole


def test_a_damaged_golden_is_an_error_with_its_path(accepted, capsys):
    (accepted / "goldens" / "lrf.golden.jsonl").write_text("{}\n")
    capsys.readouterr()
    assert main(["test", str(accepted)]) == 1
    assert "ERROR        lrf: suite/goldens/lrf.golden.jsonl: is no golden" in capsys.readouterr().out


def test_another_configuration_is_judged_by_the_expectations_alone(accepted, capsys):
    capsys.readouterr()
    assert main(["test", str(accepted), "--set", "sensors.components.lrf.severity=moderate"]) == 4
    assert verdict(capsys) == "VACUOUS"


def test_from_where_on_a_recording_is_another_flight_is_said():
    mark = ("counterfactual", 15.4, 20.0, "the recorded vehicle did otherwise")
    told = Result("x", "x.scenario.yaml", "", "", Verdict.FAIL, "why", marks=(mark,), command="again")
    assert result_lines(told) == [
        "FAIL         x: why",
        "    NOTE     from +15.400 s on, the recorded vehicle did otherwise: "
        "what is judged after that is another flight's",
        "    reproduce: again",
    ]
    passed = replace(told, verdict=Verdict.PASS)
    assert (len(result_lines(passed)), len(result_lines(passed, verbose=True))) == (1, 2)


def test_decisions_before_the_recording_are_drawn_from_where_they_begin():
    def decided(t_s, before, after):
        return Decision(
            t_ns=t_s * 10**9,
            sequence=0,
            event="x",
            before=before,
            after=after,
            step="",
            rule="x",
            values=(),
            commands=(),
        )

    lead = (decided(100, "MISSION_INPUT", "PREFLIGHT"), decided(104, "PREFLIGHT", "MISSION"))
    later = (decided(108, "MISSION_INPUT", "PREFLIGHT"), decided(109, "PREFLIGHT", "MISSION"))
    head, golden, new, *_ = waveform(lead, later, 105 * 10**9)
    assert head.startswith("states   -5 s ")
    assert head.endswith(" 4.000 s")
    assert (golden[9:].count("i"), new[9:].count("i")) == (0, 64)
