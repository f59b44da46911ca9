"""The flight page says what the recording, the journal and the replay say, marks what is not recorded, and is safe."""

from __future__ import annotations

import importlib
import json
import os
import re
import shutil
import sys
import time
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
from other_recordings import ulog_rows, write_ulog
from replay_bags import START_NS, S, flight_rows, height_m, make, write_bag
from replay_demo import demo_bag, simulated
from replay_runs import CONFIG, recording, replay

from amaze_autonomy.bags import Recording
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.journal.journal import read
from amaze_autonomy.pages.document import PageError, write_document
from amaze_autonomy.pages.flight import journal_page, replay_page
from amaze_autonomy.replay.compare import compare
from amaze_autonomy.replay.maps.proposal import propose
from amaze_autonomy.replay.maps.topic_map import load_map
from amaze_autonomy.replay.plan import make_plan
from amaze_autonomy.replay.recordings.journals import read_journals
from amaze_autonomy.replay.recordings.sources import Recordings, topics_of
from amaze_autonomy.replay.session import Session
from amaze_autonomy.tester.command import main

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
PICTURES = os.environ.get("AMAZE_PICTURES", "")
"""`./run screens` has the picture of docs/images written there."""
MAP = __file__.replace("pages/test_flight.py", "replay/flight.yaml")


def replayed(bag, topic_map):
    """Return the content of the page of a replay."""
    configuration = load_configuration(CONFIG)
    plan = make_plan(configuration, load_map(topic_map), "1", topics_of([bag]))
    with Recordings([bag], plan.topics) as recordings:
        outcome = Session(plan, recordings).run()
        return replay_page(plan, recordings, outcome, configuration.plan("1")).content


def series(content, title, name, *, scripted=False):
    """Return the points of a line of a plot."""
    plot = next(each for each in content["plots"] if each["title"] == title)
    line = next(each for each in plot["series"] if (each["name"], each["scripted"]) == (name, scripted))
    t_s, values = (np.frombuffer(b64decode(line[key]), "<f4") for key in "tv")
    known = ~np.isnan(values)
    return dict(zip(np.round(t_s[known], 3).tolist(), values[known].tolist()))


def band(content, name):
    return next(each for each in content["bands"] if each["name"] == name)


@pytest.fixture(scope="module")
def flown():
    return simulated()


@pytest.fixture(scope="module")
def bag(flown, tmp_path_factory):
    return demo_bag(tmp_path_factory.mktemp("demo") / "demo.bag", flown)


@pytest.fixture(scope="module")
def of_bag(bag):
    journal = read_journals(bag)[0]
    return journal_page(bag, journal, compare(journal)).content


def test_the_page_of_a_bag_has_the_flight_s_states_modes_and_decisions_on_the_bag_s_clock(of_bag, flown):
    decisions = [line.payload for line in read("\n".join(flown) + "\n").lines if line.kind == "decision"]
    shown = [each for each in of_bag["events"] if each["kind"] == "decision"]
    assert [each["text"].split("  by ")[1].split()[0] for each in shown][:5] == [each.rule for each in decisions][:5]
    took_off = next(each.t_ns for each in decisions if each.after == "TAKEOFF")
    began = next(each.t_ns for each in decisions if each.after == "START_RECORDING")
    states = {text: begin for begin, _, text in band(of_bag, "engine")["spans"]}
    assert states["TAKEOFF/arming"] == pytest.approx((took_off - began) / S - 0.5, abs=0.01)
    assert [text for *_, text in band(of_bag, "flight mode")["spans"]][-1].startswith("AUTO.")
    assert of_bag["background"] == "flight mode"
    assert (of_bag["counterfactual_s"], of_bag["scripted"]) == (None, [])
    assert not any(each["scripted"] or each["counterfactual"] for each in of_bag["events"])


def test_it_has_the_telemetry_the_sensors_the_track_and_the_rates(of_bag, flown):
    heights = [p.payload.height_m or 0.0 for p in read("\n".join(flown) + "\n").lines if hasattr(p.payload, "height_m")]
    assert max(series(of_bag, "Altitude", "altitude above takeoff").values()) == pytest.approx(max(heights), abs=0.02)
    assert max(series(of_bag, "Range finder", "distance").values()) > 1.0
    assert min(series(of_bag, "IMU level", "acceleration").values()) == pytest.approx(9.81, abs=0.01)
    assert max(series(of_bag, "Battery", "level").values()) > 90.0
    assert of_bag["track"]["about"] == "metres east and north of the takeoff place, by the autopilot"
    rates = {each["topic"]: each for each in of_bag["rates"]["topics"]}
    assert rates["/px4/imu"]["rate_hz"] == pytest.approx(100.0, rel=0.01)
    assert rates["/px4/imu"]["component"] == "imu"
    assert rates["/mission_camera/image_raw"]["messages"] == 0


def test_what_the_user_read_and_the_monitors_said_is_in_the_timeline(of_bag):
    texts = [each["text"] for each in of_bag["events"]]
    assert '"Takeoff."' in texts
    assert any(text.startswith("landing detection: ") for text in texts)


def test_a_journal_alone_has_a_page_without_sensors(flown, tmp_path):
    path = tmp_path / "journal.jsonl"
    path.write_text("\n".join(flown) + "\n")
    journal = read_journals(path)[0]
    content = journal_page(path, journal, compare(journal)).content
    assert [plot["title"] for plot in content["plots"]] == [
        "Altitude",
        "Speed",
        "Battery",
        "Age of the autopilot's heartbeat",
    ]
    assert content["rates"]["topics"] == []
    assert content["result"] == "COMPLETE"


def test_the_mission_and_its_fence_are_drawn_where_its_configuration_lies_beside_the_recording(bag, tmp_path):
    copied = tmp_path / "flight.bag"
    copied.write_bytes(bag.read_bytes())
    (tmp_path / "configuration").symlink_to(CONFIG)
    journal = read_journals(copied)[0]
    planned = journal_page(copied, journal, compare(journal)).content["track"]["planned"]
    waypoints = load_configuration(CONFIG).plan("1").trajectories[0].waypoints
    assert planned == [[[each.x_m, each.y_m, each.z_m] for each in waypoints]]


PLAN = {
    "fileType": "Plan",
    "version": 1,
    "geoFence": {
        "polygons": [{"polygon": [[46.9, 7.9], [46.9, 8.1], [47.1, 8.1], [47.1, 7.9]], "inclusion": True}],
        "circles": [{"circle": {"center": [47.0002, 8.0], "radius": 5.0}, "inclusion": False, "version": 1}],
    },
    "mission": {
        "plannedHomePosition": [47.0, 8.0, 400.0],
        "items": [{"type": "SimpleItem", "command": 16, "frame": 3, "params": [1, 0, 0, None, 47.00005, 8.0, 2]}],
    },
}


def test_all_fences_of_the_mission_are_drawn_circles_and_those_of_its_plan_too(bag, tmp_path):
    copied, folder = tmp_path / "flight.bag", tmp_path / "configuration"
    copied.write_bytes(bag.read_bytes())
    shutil.copytree(CONFIG, folder)
    (folder / "trajectories" / "fenced.plan").write_text(json.dumps(PLAN))
    own = "files: [trajectories/fenced.plan]\n    fence_m: [[-9, -9], [9, -9], [0, 9]]"
    missions = (folder / "missions.yaml").read_text().replace("files: [trajectories/square.csv]", own)
    (folder / "missions.yaml").write_text(missions)
    journal = read_journals(copied)[0]
    track = journal_page(copied, journal, compare(journal)).content["track"]
    assert track["fences"][0] == {"in": True, "corners": [[-9, -9], [9, -9], [0, 9]]}
    assert [(each["in"], len(each["corners"])) for each in track["fences"][1:]] == [(True, 4)]
    [circle] = track["circles"]
    assert (circle["in"], circle["radius"]) == (False, 5.0)
    assert circle["centre"] == pytest.approx([0.0, 22.2], abs=0.1)


def test_a_journal_beside_its_bag_has_the_bag_s_sensors_and_begins_with_the_recorded_mission(bag, flown, tmp_path):
    folder = tmp_path / "20261121T041730-002_1"
    folder.mkdir()
    (folder / f"{folder.name}.bag").write_bytes(bag.read_bytes())
    (folder / "journal.jsonl").write_text("\n".join(flown) + "\n")
    path = folder / "journal.jsonl"
    journal = read_journals(path)[0]
    content = journal_page(path, journal, compare(journal)).content
    assert content["title"] == "Flight 20261121T041730-002_1"
    assert content["result"] == "COMPLETE"
    assert max(series(content, "Range finder", "distance").values()) > 1.0
    assert band(content, "engine")["spans"][-1][2] == "MISSION_ENDED"
    selected = next(line.payload for line in journal.lines if type(line.payload).__name__ == "MissionSelected")
    began = next(line.payload.t_ns for line in journal.lines if getattr(line.payload, "after", "") == "START_RECORDING")
    assert content["begin_s"] == pytest.approx((selected.t_ns - began) / S - 0.5, abs=0.01)


@pytest.fixture(scope="module")
def queued():
    """Return the journal of a run with two missions, the second of which came out of the queue."""
    return simulated(mission="2,1")


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("flight, mission", [(0, "2"), (1, "1")], ids=["first", "second"])
def test_each_of_two_queued_missions_has_its_own_page_out_of_the_journal_of_both(queued, tmp_path, flight, mission):
    configuration = load_configuration(CONFIG)
    folder = tmp_path / f"20261121T041730-00{flight + 1}_{mission}"
    folder.mkdir()
    demo_bag(folder / f"{folder.name}.bag", queued, flight=flight)
    (folder / "configuration").symlink_to(CONFIG)
    (folder / "journal.jsonl").write_text("\n".join(queued) + "\n")
    path = folder / "journal.jsonl"
    journal = read_journals(path)[0]
    content = journal_page(path, journal, compare(journal)).content
    moves = [(p.payload.after, p.payload.t_ns) for p in journal.lines if hasattr(p.payload, "after")]
    begins = [t_ns for after, t_ns in moves if after == "PREFLIGHT"]
    began = sorted({t_ns for after, t_ns in moves if after == "START_RECORDING"})[flight]
    assert content["begin_s"] == pytest.approx((begins[flight] - began) / S - 0.5, abs=0.01)
    ended = sorted({t_ns for after, t_ns in moves if after == "MISSION_ENDED"})[flight]
    assert content["end_s"] == pytest.approx((ended - began) / S - 0.5, abs=0.2)
    plan = configuration.plan(mission)
    assert dict(content["facts"])["Mission"] == f"{mission} {plan.mission.description}".strip()
    assert len(content["track"]["planned"]) == len(plan.trajectories)
    assert (content["result"], content["verdict"].split(".")[0]) == ("COMPLETE", "ends in MISSION_ENDED (COMPLETE)")


def test_other_rules_are_counterfactual_from_the_first_difference_on(flown, tmp_path):
    path = tmp_path / "journal.jsonl"
    path.write_text("\n".join(flown) + "\n")
    journal = read_journals(path)[0]
    rules = load_configuration(CONFIG, ["autonomy.require_go=true"]).rules
    compared = compare(journal, rules)
    content = journal_page(path, journal, compared, rules).content
    first_s = (compared.first.event.t_ns - compared.start_ns) / S
    assert content["counterfactual_s"] == pytest.approx(first_s, abs=0.001)
    marks = {each["counterfactual"] for each in content["events"] if each["t"] >= first_s}
    assert marks == {True}


def test_a_replay_marks_what_is_scripted_and_draws_no_plot_of_it(tmp_path):
    content = replayed(write_bag(tmp_path / "flight.bag", flight_rows()), MAP)
    assert content["scripted"] == ["mode", "position", "planner", "recorder"]
    assert band(content, "planner")["scripted"]
    assert not band(content, "vehicle")["scripted"]
    assert content["background"] == "engine"
    assert content["track"] is None
    assert "Speed" not in [plot["title"] for plot in content["plots"]]
    assert {each["scripted"] for each in content["events"] if each["source"] == "script"} == {True}
    assert max(series(content, "Range finder", "distance").values()) == pytest.approx(3.05, abs=2.0)


def test_a_replay_is_counterfactual_where_the_timeline_says_so(tmp_path):
    rows = flight_rows(silent={"/imu": (15.0, 25.0)})
    bag = write_bag(tmp_path / "flight.bag", rows)
    outcome, _ = replay(bag, MAP)
    content = replayed(bag, MAP)
    assert content["counterfactual_s"] == pytest.approx((outcome.counterfactual_ns - outcome.start_ns) / S, abs=0.001)
    assert [each["counterfactual"] for each in content["events"]] == [line.counterfactual for line in outcome.timeline]


def test_ranges_at_or_above_the_limit_are_nothing_seen(tmp_path):
    rows = flight_rows()
    for _, topic, message in rows:
        if topic == "/range":
            message.max_range = 1.5
    content = replayed(write_bag(tmp_path / "flight.bag", rows), MAP)
    assert max(series(content, "Range finder", "distance").values()) < 1.5
    unseen = series(content, "Range finder", "nothing seen: at or above its limit").values()
    assert set(unseen) == {1.5}


HOSTILE = "</script><img src=x onerror=alert(1)><b>\u2028 &lt;"


def test_names_in_a_recording_never_become_markup(tmp_path):
    """Only what the page itself consists of may hold markup: names are JSON without "<", and put in as text."""
    log = make(
        "rosgraph_msgs/msg/Log",
        header=make(
            "std_msgs/msg/Header", seq=0, stamp=make("builtin_interfaces/msg/Time", sec=0, nanosec=0), frame_id=""
        ),
        level=8,
        name=HOSTILE,
        msg=HOSTILE,
        file="",
        function="",
        line=0,
        topics=[],
    )
    rows = sorted([*flight_rows(), (START_NS + S, "/rosout", log)], key=lambda row: row[0])
    bag = write_bag(tmp_path / "flight<i>.bag", rows)
    page = tmp_path / "flight.html"
    assert main(["run", str(bag), "--map", MAP, "--html", str(page)]) == 0
    text = page.read_text("utf-8")
    assert text.count("onerror=alert") == 2
    assert "<img src=x" not in text
    data = re.search(r"^const CONTENT = (.*);$", text, re.MULTILINE).group(1)
    assert "<" not in data
    content = json.loads(data)
    assert HOSTILE in next(each["text"] for each in content["events"] if each["kind"] == "text")
    assert content["title"] == "Replay of flight<i>.bag"
    assert "<title>Replay of flight&lt;i&gt;.bag</title>" in text


def test_the_scripts_put_text_in_as_text_and_escape_it_for_the_plot_library():
    folder = Path(sys.modules["amaze_autonomy.pages.document"].__file__).parent
    scripts = "".join(path.read_text("utf-8") for path in folder.glob("*.js"))
    assert not re.findall(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(", scripts)


@pytest.mark.live
@pytest.mark.skipif(not CHROMIUM or not DRIVER, reason="no Chromium here: apt-get install chromium chromium-driver")
def test_what_is_in_view_is_drawn_at_once_and_three_dimensions_for_who_asks_for_them(bag, tmp_path):
    webdriver = pytest.importorskip("selenium.webdriver")
    (tmp_path / "configuration").symlink_to(CONFIG)
    flight = tmp_path / "20261121T041730-001_1.bag"
    shutil.copyfile(bag, flight)
    journal, page = read_journals(flight)[0], tmp_path / "flight.html"
    content = journal_page(flight, journal, compare(journal)).content
    write_document(page, "title", ("flight",), content)
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for each in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader"):
        options.add_argument(each)
    options.add_argument("--window-size=1400,1100")
    with webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER)) as browser:

        def until(script):
            deadline_s = time.monotonic() + 120.0
            while not browser.execute_script(f"return {script}"):
                assert time.monotonic() < deadline_s, script

        browser.get(page.as_uri())
        until("document.querySelectorAll('.pair .xy').length > 0")
        assert browser.execute_script("return document.querySelectorAll('.gl-container canvas').length") == 0
        browser.execute_script("document.getElementById('solid').click()")
        until("document.querySelectorAll('.pair .gl-container canvas').length > 0")
        assert browser.execute_script("return document.getElementById('solid')") is None
        last = len(content["plots"])  # behind what happened; the rates come behind it
        browser.execute_script(f"flight.charts[{last}].div.scrollIntoView()")
        until(f"(flight.charts[{last}].div.data || []).length > 0")  # numbers that were left alone until then
        errors = [each["message"] for each in browser.get_log("browser") if each["level"] == "SEVERE"]
        assert errors == []
        if PICTURES:
            browser.execute_script("scrollTo(0, 0)")
            time.sleep(1.0)
            browser.save_screenshot(str(Path(PICTURES) / "flight-page.png"))


def test_a_page_loads_nothing(tmp_path):
    page = tmp_path / "flight.html"
    write_document(page, "title", ("flight",), {})
    own = re.sub(r"<script>\n/\*\*.*?</script>", "", page.read_text("utf-8"), flags=re.DOTALL)
    assert "Plotly.react" in own
    assert not re.findall(r"https?://|<link|@import|url\(|\bsrc=", own)


def test_without_the_plot_library_it_says_how_to_get_it_and_data_is_not_harmed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("amaze_autonomy.pages.document._PLOTS", ("no_such_library", "plotly.min.js"))
    with pytest.raises(PageError, match=r"pip install 'amaze_autonomy\[page\]'"):
        write_document(tmp_path / "a.html", "title", ("flight",), {})
    bag = write_bag(tmp_path / "flight.bag", flight_rows())
    assert main(["run", str(bag), "--map", MAP, "--html", str(tmp_path / "a.html")]) == 2
    assert "plotly, which is not installed here" in capsys.readouterr().err
    assert main(["run", str(bag), "--map", MAP, "--out", str(tmp_path / "out")]) == 0
    assert "no flight.html: " in capsys.readouterr().err
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "journal.jsonl",
        "result.json",
        "timeline.txt",
    ]


@pytest.mark.parametrize(
    "size_mb, open_ms, status", [(14.9, 2000, 0), (14.9, 2001, 1), (15.1, 100, 1)], ids=["met", "slow", "large"]
)
def test_the_bench_of_the_page_ends_with_1_when_a_page_is_slow_or_large(
    tmp_path, monkeypatch, capsys, size_mb, open_ms, status
):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "bench"))
    bench = importlib.import_module("flight_page")
    monkeypatch.setattr(bench, "opened", lambda *_: bench.Opened(open_ms, 50, 70))
    pages = [tmp_path / "small.html", tmp_path / "flight.html"]
    for page, mb in zip(pages, (0.0, size_mb)):
        with page.open("wb") as file:
            file.truncate(int(mb * 1e6))
    assert bench.main([str(page) for page in reversed(pages)]) == status
    assert ("MISSED" in capsys.readouterr().out) == bool(status)


def test_run_with_a_folder_puts_the_page_beside_the_other_results(tmp_path):
    bag = write_bag(tmp_path / "flight.bag", flight_rows())
    assert main(["run", str(bag), "--map", MAP, "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "flight.html").stat().st_size < 15_000_000
    assert main(["run", str(bag), "--map", MAP, "--out", str(tmp_path / "other"), "--no-html"]) == 0
    assert not (tmp_path / "other" / "flight.html").exists()


def test_a_telemetry_log_has_texts_modes_and_a_track():
    path = recording("px4_battery_drain.tlog")
    content = replayed(path, "px4_telemetry")
    assert [text for *_, text in band(content, "flight mode")["spans"]] == [
        "AUTO.LOITER",
        "AUTO.MISSION",
        "AUTO.LOITER",
        "AUTO.LAND",
        "AUTO.MISSION",
    ]
    assert any("Takeoff detected" in each["text"] for each in content["events"])
    assert content["track"]["labels"][:2] == ["AUTO.LOITER", "AUTO.MISSION"]
    assert 20.0 < max(series(content, "Tilt", "attitude of the autopilot").values()) < 45.0


def test_a_ulog_has_texts_modes_plots_and_a_track(tmp_path):
    log = write_ulog(tmp_path / "flight.ulg", ulog_rows(), [(7.6, 6, "Armed by stick"), (26.0, 4, "Landing")])
    (tmp_path / "map.yaml").write_text(propose([log]).text)
    page = tmp_path / "flight.html"
    assert main(["run", str(log), "--map", str(tmp_path / "map.yaml"), "--mission", "1", "--html", str(page)]) == 0
    content = json.loads(re.search(r"^const CONTENT = (.*);$", page.read_text("utf-8"), re.MULTILINE).group(1))

    assert band(content, "flight mode")["spans"] == [
        [0.0, 8.0, "AUTO.LOITER"],
        [8.0, 26.0, "AUTO.MISSION"],
        [26.0, 35.98, "AUTO.LAND"],
    ]
    assert content["background"] == "flight mode"
    assert content["track"]["labels"] == ["AUTO.LOITER", "AUTO.MISSION", "AUTO.LAND"]
    assert [(each["t"], each["text"]) for each in content["events"] if "says" in each["text"]] == [
        (7.6, "the autopilot says: Armed by stick"),
        (26.0, "the autopilot says: Landing"),
    ]
    assert [each["title"] for each in content["plots"]] == [
        "Altitude",
        "Speed",
        "Battery",
        "Range finder",
        "Tilt",
        "IMU level",
        "Age of the autopilot's heartbeat",
    ]
    heights = series(content, "Altitude", "z of the estimate")
    assert heights == pytest.approx({t_s: height_m(t_s) for t_s in heights}, abs=1e-3)
    ranges = series(content, "Range finder", "distance")
    assert (len(ranges), ranges[20.0]) == (360, pytest.approx(3.1))
    assert max(series(content, "IMU level", "acceleration").values()) == pytest.approx(9.81)
    watched = {each["component"]: each["rate_hz"] for each in content["rates"]["topics"]}
    assert watched["imu"] == pytest.approx(50.0)


@pytest.mark.parametrize(
    "read, said",
    [(True, ("note", "the autopilot says: Takeoff detected")), (False, ("text", "autopilot: Takeoff detected"))],
)
def test_a_text_stands_there_once_whether_the_map_reads_it_or_not(tmp_path, read, said):
    folder = Path(sys.modules["amaze_autonomy.replay.maps.topic_map"].__file__).parent
    lines = (folder / "px4_telemetry.yaml").read_text().splitlines(keepends=True)
    (tmp_path / "map.yaml").write_text("".join(line for line in lines if read or "STATUSTEXT" not in line))
    content = replayed(recording("px4_battery_drain.tlog"), str(tmp_path / "map.yaml"))
    events = [(each["kind"], each["text"].strip()) for each in content["events"]]
    assert [each for each in events if "Takeoff detected" in each[1]] == [said]


def test_texts_that_the_timeline_folds_into_one_line_do_not_stand_there_again():
    content = replayed(recording("copter_low_battery.tlog"), "copter_low_battery")
    fix = [(each["kind"], each["times"]) for each in content["events"] if "Need 3D Fix" in each["text"]]
    assert fix == [("note", 5)]


def test_a_tilt_in_flight_is_no_error_of_a_nominal_flight():
    content = replayed(recording("px4_normal_mission.tlog"), "px4_telemetry")
    tilts = [each["level"] for each in content["events"] if "state check: tilt" in each["text"]]
    assert (len(tilts), set(tilts)) == (7, {0})


def test_a_real_bag_has_its_shock_and_its_gaps():
    path = recording("ardrone_indoor_flight.bag")
    content = replayed(path, "ardrone_indoor_flight")
    assert max(series(content, "IMU level", "acceleration").values()) == pytest.approx(31.0, abs=1.0)
    imu = next(each for each in content["rates"]["topics"] if each["component"] == "imu")
    with Recording(path) as bag:
        times = np.array([entry.t_ns for entry in bag.entries("/ardrone/imu")])
    assert imu["longest_s"] == pytest.approx(np.diff(times).max() / S)
    assert imu["longest_at_s"] == pytest.approx(101.66, abs=0.01)
    assert imu["gaps"][0] == pytest.approx((99.926, 100.143), abs=0.01)  # what the watchdog calls silence at 100.14
