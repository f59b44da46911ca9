"""`amaze-replay corpus`: the same results in any number of processes, on a cluster, and with bags from elsewhere."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from killed_work import dying, examining, hunting
from replay_bags import break_chunk, flight_rows, write_bag

from amaze_autonomy.replay.errors import ReplayError
from amaze_autonomy.tester.command import main
from amaze_autonomy.tester.corpus import examined, kept_in, run_on_cluster, run_remotely
from amaze_autonomy.tester.coverage import Hunt, mutation_lines, mutation_passed, run_hunts
from amaze_autonomy.tester.task import Options, Task, Verdict, tasks_of

MAP = Path(__file__).parents[1] / "replay" / "flight.yaml"
FLIGHT = """\
version: 1
description: "A flight that ends by itself."
bags: [{{path: "{bag}", sha256: "{sha256}"}}]
map: "{map}"
expectations:
  - {{expect: exists, of: {{state: MISSION_ENDED}}}}
"""
NOMINAL = """\
version: 1
description: "Nothing fails."
expectations:
  - {expect: exists, of: {state: MISSION_ENDED}}
"""


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def corpus(tmp_path, monkeypatch):
    """Two flights, one of them longer, and a simulation; the bags lie in a folder of their own."""
    bags, scenarios = tmp_path / "bags", tmp_path / "corpus"
    for each in (bags, scenarios):
        each.mkdir()
    for name, length_s in (("short", 36.0), ("long", 40.0)):
        path = write_bag(bags / f"{name}.bag", flight_rows(length_s), "lz4")
        text = FLIGHT.format(bag=f"${{AMAZE_DATA}}/{name}.bag", sha256=sha256(path), map=MAP)
        (scenarios / f"{name}.scenario.yaml").write_text(text)
    (scenarios / "nominal.scenario.yaml").write_text(NOMINAL)
    monkeypatch.setenv("AMAZE_DATA", str(bags))
    return scenarios


def run(corpus, capfd, *arguments):
    """Return exit status, output, and the lines of the table without its times."""
    capfd.readouterr()
    status = main(["corpus", str(corpus), "--no-goldens", *arguments])
    out, err = capfd.readouterr()
    return status, out, [line.split()[0] for line in err.splitlines() if line.strip()]


@pytest.mark.night
def test_two_processes_print_what_one_prints(corpus, capfd):
    one = run(corpus, capfd, "-j1")
    assert one[0] == 0
    assert [line.split()[:2] for line in one[1].splitlines()] == [
        ["PASS", "long:"],
        ["PASS", "nominal:"],
        ["PASS", "short:"],
        ["3", "PASS;"],
    ]
    assert one[2] == ["flight", "long", "nominal", "short", "all"]
    two = run(corpus, capfd, "-j2")
    assert two[:2] == one[:2]
    assert two[2] == [*one[2], "2"]


def test_the_results_have_figures(corpus, capfd, tmp_path):
    run(corpus, capfd, "-j1", "--json", str(tmp_path / "r.json"))
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["verdict"] == "PASS"
    figures = {each["id"]: each["figures"] for each in result["tests"]}
    assert figures["long"]["flown_s"] == pytest.approx(39.98)
    assert all(each["wall_s"] > 0 and each["cpu_s"] > 0 and each["peak_mb"] > 10 for each in figures.values())


@pytest.mark.night
@pytest.mark.parametrize("jobs", ["-j1", "-j2"])
def test_damage_of_bags_is_said_first(corpus, capfd, jobs):
    path = Path(os.environ["AMAZE_DATA"]) / "long.bag"
    break_chunk(path, 0, 300, 50)
    text = (corpus / "long.scenario.yaml").read_text()
    (corpus / "long.scenario.yaml").write_text(re.sub('sha256: ".*"', f'sha256: "{sha256(path)}"', text))
    status, out, _ = run(corpus, capfd, jobs)
    assert status == 3
    lines = out.splitlines()
    assert lines[0].startswith(f"damaged: {path}: byte ")
    assert lines[1].startswith("INCONCLUSIVE long: ")
    assert run(corpus, capfd, jobs, "--no-doctor")[1].startswith("INCONCLUSIVE long: ")


def test_a_scenario_with_a_mistake_is_an_error_and_the_others_run(corpus, capfd):
    (corpus / "bad.scenario.yaml").write_text("version: 1\nwhat: 3\n")
    status, out, _ = run(corpus, capfd, "-j2")
    assert status == 1
    assert [line.split()[0] for line in out.splitlines() if not line.startswith(" ")] == [
        "ERROR",
        "PASS",
        "PASS",
        "PASS",
        "3",
    ]


@pytest.fixture
def killed(monkeypatch, tmp_path):
    monkeypatch.setenv("DIED", str(tmp_path / "died"))
    monkeypatch.setattr("amaze_autonomy.tester.run.run_task", dying)
    return lambda how: monkeypatch.setenv("DIES", how)


def test_a_process_that_is_killed_costs_nothing_when_its_task_can_be_run_by_itself(corpus, capfd, killed):
    killed("once")
    status, out, _ = run(corpus, capfd, "-j2", "--no-doctor")
    assert (status, out.splitlines()[-1].split(";")[0]) == (0, "3 PASS")


@pytest.mark.night
def test_a_task_whose_process_is_killed_again_is_an_error_and_the_others_have_results(corpus, capfd, killed, tmp_path):
    killed("always")
    status, out, _ = run(corpus, capfd, "-j2", "--no-doctor", "--json", str(tmp_path / "r.json"))
    assert status == 1
    first, *_, last = out.splitlines()
    assert first == "ERROR        long: the process that ran it died, twice: was it killed, or is the memory too small?"
    assert last.startswith("2 PASS, 1 ERROR")
    verdicts = [each["verdict"] for each in json.loads((tmp_path / "r.json").read_text())["tests"]]
    assert verdicts == ["ERROR", "PASS", "PASS"]


def test_a_bag_that_kills_the_process_is_said_and_the_others_are_looked_through(corpus, monkeypatch):  # noqa: ARG001
    monkeypatch.setattr("amaze_autonomy.tester.corpus._examined", examining)
    bags = sorted(Path(os.environ["AMAZE_DATA"]).iterdir())
    died = f"{bags[0]}: the process that looked through it died, twice: was it killed, or is the memory too small?"
    assert examined(bags, jobs=2) == (died, "short.bag: looked at")


def test_a_mutant_that_kills_the_process_is_not_caught_and_the_others_are_hunted(monkeypatch):
    monkeypatch.setattr("amaze_autonomy.tester.coverage.run_hunt", hunting)
    told = []
    found = run_hunts([Hunt(name, (), ()) for name in ("one", "deadly", "other")], 2, told.append)
    assert tuple(told) == found
    died = "the process that hunted it died, twice: was it killed, or is the memory too small?"
    assert mutation_lines(found, {}) == [
        f"UNKNOWN   deadly: {died}",
        "2 of 3 mutants caught, 0 waived, 0 survive, 1 unknown",
    ]
    assert not mutation_passed(found, {"mutant deadly": "it may survive, but it is not known to"})


@pytest.fixture
def elsewhere(corpus, tmp_path, monkeypatch):  # noqa: ARG001  (it writes the bags)
    """The same bags, but only behind a URL."""
    pytest.importorskip("fsspec", reason="fsspec is not installed: pip install '.[cluster]'")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    bags = Path(os.environ["AMAZE_DATA"])
    monkeypatch.delenv("AMAZE_DATA")
    return bags.as_uri()


def test_bags_are_fetched_once_from_a_url(corpus, capfd, elsewhere, tmp_path):
    status, out, _ = run(corpus, capfd, "-j2", "--data", elsewhere)
    assert (status, out.splitlines()[-1].split(";")[0]) == (0, "3 PASS")
    assert "AMAZE_DATA" not in os.environ
    kept = kept_in(elsewhere)
    assert sorted(path.name for path in kept.iterdir()) == ["long.bag", "short.bag"]
    shutil.rmtree(tmp_path / "bags")
    assert run(corpus, capfd, "-j1", "--data", elsewhere)[:2] == (status, out)


def test_a_kept_bag_that_is_another_one_is_fetched_again(corpus, capfd, elsewhere):
    run(corpus, capfd, "-j1", "--data", elsewhere)
    path = kept_in(elsewhere) / "short.bag"
    path.write_bytes(path.read_bytes()[:1000])
    assert run(corpus, capfd, "-j1", "--data", elsewhere)[0] == 0


def test_a_bag_that_cannot_be_fetched_is_an_error_of_its_scenarios_alone(corpus, capfd, elsewhere, tmp_path):
    (tmp_path / "bags" / "long.bag").unlink()
    status, out, _ = run(corpus, capfd, "-j1", "--data", elsewhere)
    assert status == 1
    first, *_, last = out.splitlines()
    assert first.startswith(f"ERROR        long: {elsewhere}/long.bag: cannot be fetched (")
    assert last.startswith("2 PASS, 1 ERROR")
    assert sorted(path.name for path in kept_in(elsewhere).iterdir()) == ["short.bag"]


@pytest.mark.slow_rows
@pytest.mark.parametrize("way", ["..", "inside/..", "linked"])
def test_nothing_is_fetched_to_a_place_outside_of_what_is_kept(corpus, capfd, elsewhere, tmp_path, way):
    """The scenario may be anybody's: it names no file of its reader, here or there, that would be replaced."""
    kept = kept_in(elsewhere)
    kept.mkdir(parents=True)
    (kept / "linked").symlink_to(kept.parent)
    target = kept.parent / "mine.bag"
    target.write_text("mine")
    for place in (tmp_path / "mine.bag", tmp_path / "bags" / "mine.bag"):
        shutil.copy(tmp_path / "bags" / "short.bag", place)
    text = (corpus / "short.scenario.yaml").read_text()
    (corpus / "short.scenario.yaml").write_text(text.replace("/short.bag", f"/{way}/mine.bag"))
    status, out, _ = run(corpus, capfd, "-j1", "--data", elsewhere)
    assert status == 1
    assert f"ERROR        short: {kept}/{way}/mine.bag: leads out of the folder of bags that are fetched; " in out
    assert out.splitlines()[-1].startswith("2 PASS, 1 ERROR")
    assert target.read_text() == "mine"
    assert sorted(path.name for path in kept.iterdir()) == ["linked", "long.bag"]


def test_what_is_kept_stays_when_what_is_fetched_is_another_one(corpus, capfd, elsewhere, tmp_path):
    assert run(corpus, capfd, "-j1", "--data", elsewhere)[0] == 0
    before = (kept_in(elsewhere) / "short.bag").read_bytes()
    other = sha256(tmp_path / "bags" / "long.bag")
    text = (corpus / "short.scenario.yaml").read_text()
    (corpus / "short.scenario.yaml").write_text(re.sub('sha256: ".*"', f'sha256: "{other}"', text))
    status, out, _ = run(corpus, capfd, "-j1", "--data", elsewhere)
    assert status == 1
    words = "is another file than the scenario was written for (sha256 differs)"
    assert f"ERROR        short: {elsewhere}/short.bag: {words}\n" in out
    assert (kept_in(elsewhere) / "short.bag").read_bytes() == before
    assert sorted(path.name for path in kept_in(elsewhere).iterdir()) == ["long.bag", "short.bag"]


@pytest.fixture(scope="module")
def cluster():
    """A real scheduler on a port of its own, with two worker processes."""
    distributed = pytest.importorskip("distributed", reason="distributed is not installed: pip install '.[cluster]'")
    workers = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(host="127.0.0.1", **workers) as cluster:
        yield cluster.scheduler_address


@pytest.mark.night
@pytest.mark.filterwarnings("default")
def test_a_cluster_prints_what_one_process_prints(cluster, corpus, capfd, tmp_path, monkeypatch):
    expected = run(corpus, capfd, "-j1")[:2]
    pytest.importorskip("fsspec")
    bags = Path(os.environ["AMAZE_DATA"]).as_uri()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    status, out, table = run(corpus, capfd, "--dask", cluster, "--data", bags)
    assert (status, out) == expected
    assert table[-2:] == ["all", "2"]


@pytest.mark.filterwarnings("default")
def test_every_task_of_a_cluster_has_a_result_in_its_place(cluster, corpus):
    (corpus / "bad.scenario.yaml").write_text("version: 1\nwhat: 3\n")
    tasks = tasks_of([corpus], Options(goldens=False))
    told = []
    results, workers = run_on_cluster(cluster, tasks, Path(os.environ["AMAZE_DATA"]).as_uri(), told.append)
    assert workers == 2
    assert tuple(told) == results
    assert [(each.id, each.verdict) for each in results] == [
        ("bad", Verdict.ERROR),
        ("long", Verdict.PASS),
        ("nominal", Verdict.PASS),
        ("short", Verdict.PASS),
    ]


def test_threads_of_one_worker_keep_their_folders_apart(monkeypatch):
    """The folder is a variable of the process: a worker of Dask has a thread for each core."""

    def running(task):
        before = os.environ["AMAZE_DATA"]
        time.sleep(0.02)
        return task.path, before, os.environ["AMAZE_DATA"]

    monkeypatch.setenv("AMAZE_DATA", "/own")
    monkeypatch.setattr("amaze_autonomy.tester.corpus.run_task", running)
    monkeypatch.setattr("amaze_autonomy.tester.corpus.fetch_bags", lambda *_: None)
    urls = ["file:///a", "", "file:///b"] * 3
    with ThreadPoolExecutor(3) as threads:
        found = list(threads.map(lambda url: run_remotely(Task(url), url), urls))
    folders = [str(kept_in(url)) if url else "/own" for url in urls]
    assert found == [(url, folder, folder) for url, folder in zip(urls, folders)]
    assert os.environ["AMAZE_DATA"] == "/own"


def test_two_that_fetch_one_bag_write_files_of_their_own(corpus, elsewhere, monkeypatch):
    parts = []
    monkeypatch.setattr("amaze_autonomy.tester.corpus._check_content", lambda _, part, __: parts.append(part.name))
    for _ in range(2):
        run_remotely(Task(str(corpus / "short.scenario.yaml"), options=Options(goldens=False)), elsewhere)
        (kept_in(elsewhere) / "short.bag").unlink()
    assert len(set(parts)) == 2


def test_no_scheduler_is_one_clear_error(monkeypatch):
    pytest.importorskip("distributed", reason="distributed is not installed: pip install '.[cluster]'")
    monkeypatch.setattr("amaze_autonomy.tester.corpus._CONNECT_S", 0.5)
    with pytest.raises(ReplayError, match=r"^tcp://127\.0\.0\.1:9: no scheduler answers \(.*\); start one with"):
        run_on_cluster("tcp://127.0.0.1:9", ())
