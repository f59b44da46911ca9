"""A map proposed for a recording that nobody described gives a first useful timeline, without an edit."""

from __future__ import annotations

from math import nan
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from cns_definitions import MESSAGES
from replay_bags import START_NS, STORE, S, battery, flight_rows, header, height_m, imu, magnetic, make, write_bag
from replay_runs import CONFIG, moves, recording, replay, texts
from rosbags.typesys import get_types_from_msg

from amaze_autonomy.cns.tables import TOPICS
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.engine.events import Landed, MissionPhase
from amaze_autonomy.replay.errors import NoMessagesError
from amaze_autonomy.replay.maps.proposal import propose, propose_of
from amaze_autonomy.replay.maps.topic_map import load_map
from amaze_autonomy.replay.plan import make_plan
from amaze_autonomy.replay.recordings.sources import Recordings, recordings_of, topics_of
from amaze_autonomy.replay.session import Session
from amaze_autonomy.replay.timeline import LineKind
from amaze_autonomy.tester.command import main

pytestmark = pytest.mark.long

NOMINAL = ["PREFLIGHT", "READY", "START_RECORDING", "LOAD_MISSION", "TAKEOFF", "MISSION", "DATA_CLEANUP"]
STATE = """\
std_msgs/Header header
bool connected
bool armed
bool guided
bool manual_input
string mode
uint8 system_status
"""
EXTENDED = """\
std_msgs/Header header
uint8 vtol_state
uint8 landed_state
"""


ALTITUDE = """\
std_msgs/Header header
float32 monotonic
float32 amsl
float32 local
float32 relative
float32 terrain
float32 bottom_clearance
"""


def types():
    if "mavros_msgs/msg/State" not in STORE.types:
        STORE.register(get_types_from_msg(STATE, "mavros_msgs/msg/State"))
        STORE.register(get_types_from_msg(EXTENDED, "mavros_msgs/msg/ExtendedState"))
        STORE.register(get_types_from_msg(ALTITUDE, "mavros_msgs/msg/Altitude"))


def pose(t_ns, z):
    point = make("geometry_msgs/msg/Point", x=1.0, y=2.0, z=float(z))
    level = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    whole = make("geometry_msgs/msg/Pose", position=point, orientation=level)
    return make("geometry_msgs/msg/PoseStamped", header=header(t_ns), pose=whole)


def mavros_rows(length_s=36.0, mode="OFFBOARD", state_hz=1.0, shift_s=0.0):
    """Return what mavros says of the flight of `replay_bags.height_m`: armed at 7.6 s, up at 8 s, down at 30 s."""
    types()
    rows = []
    streams = (
        ("/mavros/imu/data", 50.0, lambda at, _: imu(at)),
        ("/mavros/imu/data_raw", 50.0, lambda at, _: imu(at)),
        ("/mavros/imu/mag", 10.0, lambda at, _: magnetic(at)),
        ("/mavros/local_position/pose", 30.0, lambda at, t_s: pose(at, height_m(t_s))),
        ("/mavros/setpoint_position/local", 20.0, lambda at, _: pose(at, 3.0)),
        ("/mavros/battery", 1.0, lambda at, _: battery(at, 0.8)),
        ("/mavros/state", state_hz, lambda at, t_s: state(at, armed=7.6 <= t_s < 31.5, mode=mode)),
        ("/mavros/extended_state", state_hz, lambda at, t_s: extended(at, 1 if height_m(t_s) <= 0.01 else 2)),
    )
    for topic, rate_hz, message in streams:
        for step in range(int((length_s - shift_s) * rate_hz)):
            at = START_NS + round(step / rate_hz * S)
            rows.append((at, topic, message(at, shift_s + step / rate_hz)))
    return sorted(rows, key=lambda row: row[0])


def state(at, *, armed, mode):
    return make(
        "mavros_msgs/msg/State",
        header=header(at),
        connected=True,
        armed=bool(armed),
        guided=True,
        manual_input=False,
        mode=mode,
        system_status=4,
    )


def extended(at, landed):
    return make("mavros_msgs/msg/ExtendedState", header=header(at), vtol_state=0, landed_state=landed)


def altitude(at, **known):
    parts = ("monotonic", "amsl", "local", "relative", "terrain", "bottom_clearance")
    return make("mavros_msgs/msg/Altitude", header=header(at), **{part: known.get(part, nan) for part in parts})


def rows_by_altitude(**parts):
    """Return the flight as a mavros says it of which the altitude was recorded, not the position."""
    rows = [row for row in mavros_rows() if row[1] != "/mavros/local_position/pose"]
    for step in range(360):
        at, height = START_NS + step * S // 10, height_m(step / 10)
        rows.append((at, "/mavros/altitude", altitude(at, **{part: height + more for part, more in parts.items()})))
    return sorted(rows, key=lambda row: row[0])


def proposed(tmp_path, *bags):
    proposal = propose(bags)
    path = tmp_path / "proposed.yaml"
    path.write_text(proposal.text)
    return proposal, str(path)


def states(outcome):
    return [after for before, after, _ in moves(outcome) if before != after]


def test_a_flight_over_mavros_is_a_whole_mission_by_the_proposed_map(tmp_path):
    bag = write_bag(tmp_path / "x.bag", mavros_rows())
    proposal, path = proposed(tmp_path, bag)
    assert proposal.found == (
        "armed: disarmed +0.0 s, armed +8.0 s, disarmed +32.0 s",
        "flight mode: OFFBOARD +0.0 s",
        "landed: on the ground +0.0 s, in the air +9.0 s, on the ground +30.0 s",
        "not watched: /mavros/imu/data_raw (another imu)",
    )
    assert proposal.scripted == ("mission planner", "data recorder")
    found = load_map(path)
    assert {name: reading.topic for name, reading in found.readings.items()} == {
        "imu": "/mavros/imu/data",
        "estimate": "/mavros/local_position/pose",
        "height": "/mavros/local_position/pose",
        "battery": "/mavros/battery",
        "armed": "/mavros/state",
        "mode": "/mavros/state",
        "failsafe": "/mavros/state",
        "landed": "/mavros/extended_state",
    }
    assert [component.name for component in found.components] == ["imu", "magnetometer"]
    outcome, _ = replay(bag, path)
    assert states(outcome)[:7] == NOMINAL
    assert outcome.counterfactual_ns is None


def test_the_shipped_map_for_mavros_selects_before_the_recorded_arming(tmp_path):
    bag = write_bag(tmp_path / "x.bag", mavros_rows())
    outcome, _ = replay(bag, "mavros")
    assert states(outcome)[:7] == NOMINAL
    selected = outcome.decisions[0]
    assert (selected.rule, (selected.t_ns - START_NS) / S) == ("mission_selected", 2.5)


@pytest.mark.parametrize(
    "parts, field", [({"relative": 0.0, "local": 0.2, "amsl": 400.0}, "relative"), ({"local": 0.0}, "local")]
)
def test_where_no_pose_is_recorded_the_height_is_that_of_mavros_altitude(tmp_path, parts, field):
    bag = write_bag(tmp_path / "x.bag", rows_by_altitude(**parts))
    proposal, path = proposed(tmp_path, bag)
    assert proposal.scripted == ("mission planner", "data recorder")
    height = load_map(path).readings["height"]
    assert (height.topic, height.fields, height.offset) == ("/mavros/altitude", {"height": field}, 0.0)
    outcome, _ = replay(bag, path)
    assert states(outcome)[:7] == NOMINAL


def test_the_shipped_map_for_mavros_takes_the_altitude_where_the_position_is_not_recorded(tmp_path):
    bag = write_bag(tmp_path / "x.bag", rows_by_altitude(relative=0.0))
    outcome, _ = replay(bag, "mavros")
    assert states(outcome)[:7] == NOMINAL
    (takeoff,) = [each for each in outcome.decisions if each.rule == "at_takeoff_height"]
    assert 9.0 < (takeoff.t_ns - START_NS) / S < 12.0


def test_the_height_of_the_shipped_map_for_mavros_is_the_position_where_both_are_recorded():
    both, pose_topic = load_map("mavros"), "/mavros/local_position/pose"
    assert both.of([pose_topic, "/mavros/altitude"]).readings["height"].topic == pose_topic
    assert both.of(["/mavros/altitude"]).readings["height"].topic == "/mavros/altitude"
    assert both.of([]).readings["height"].topic == pose_topic  # that it is not there is said of this one
    assert "height_otherwise" not in both.of([]).readings


def test_the_shipped_map_for_mavros_flies_what_the_configuration_for_mavros_records(tmp_path):
    groups = yaml.safe_load((CONFIG / "mavros" / "recording.yaml").read_text())["groups"].values()
    recorded = {topic for group in groups for topic in group["topics"]}
    rows = [row for row in mavros_rows() if row[1] in recorded]
    assert {topic for _, topic, _ in rows} & {"/mavros/imu/data", "/mavros/imu/data_raw"} == {"/mavros/imu/data_raw"}
    outcome, _ = replay(write_bag(tmp_path / "x.bag", rows), "mavros", config=CONFIG / "mavros")
    assert states(outcome)[:7] == NOMINAL


def test_the_imu_of_the_shipped_map_for_mavros_is_the_filtered_one_where_both_are_recorded():
    def topics(*recorded):
        found = load_map("mavros").of(recorded)
        return found.readings["imu"].topic, *(component.topic.topic for component in found.components)

    filtered, raw = "/mavros/imu/data", "/mavros/imu/data_raw"
    assert topics(filtered, raw) == topics(filtered) == topics() == (filtered, filtered)
    assert topics(raw) == (raw, raw)
    assert "imu_otherwise" not in load_map("mavros").of([raw]).readings


def test_a_bag_over_mavros_that_begins_in_the_air_is_judged_from_there_by_the_shipped_map(tmp_path):
    bag = write_bag(tmp_path / "x.bag", mavros_rows(shift_s=12.0))
    outcome, _ = replay(bag, "mavros")
    assert "the recording begins in the air at 3.0 m (landed is IN_AIR)" in " ".join(texts(outcome, LineKind.NOTE))
    assert states(outcome)[:7] == NOMINAL


@pytest.mark.parametrize("state_hz", [0.4, 1.0, 10.0])
def test_slow_telemetry_does_not_flap(tmp_path, state_hz):
    bag = write_bag(tmp_path / "x.bag", mavros_rows(state_hz=state_hz))
    _, path = proposed(tmp_path, bag)
    outcome, _ = replay(bag, path)
    assert states(outcome)[:7] == NOMINAL


def test_a_recorded_pilot_is_a_pilot(tmp_path):
    rows = mavros_rows(state_hz=10.0)
    for at, topic, message in rows:
        if topic == "/mavros/state" and (at - START_NS) / S >= 25.0:
            message.mode = "POSCTL"
    bag = write_bag(tmp_path / "x.bag", rows)
    _, path = proposed(tmp_path, bag)
    outcome, _ = replay(bag, path)
    (taken,) = [d for d in outcome.decisions if d.after == "PILOT" and d.before == "MISSION"]
    assert 25.0 <= (taken.t_ns - START_NS) / S < 26.0


def changed(rows, **values):
    """Return rows in which the vehicle's state says something else from 20 s on."""
    for at, topic, message in rows:
        if topic == "/mavros/state" and (at - START_NS) / S >= 20.0:
            for name, value in values.items():
                setattr(message, name, value)
    return rows


def test_a_recorded_failsafe_is_one(tmp_path):
    rows = changed(mavros_rows(state_hz=10.0), system_status=5, mode="AUTO.LOITER")
    _, path = proposed(tmp_path, write_bag(tmp_path / "x.bag", rows))
    outcome, _ = replay(tmp_path / "x.bag", path)
    taken = next(d for d in outcome.decisions if d.after == "PILOT")
    assert 20.0 <= (taken.t_ns - START_NS) / S < 21.0
    assert "failsafe" in " ".join(str(value.value) for value in taken.values)


def test_modes_of_an_ardupilot_behind_mavros_are_read_by_its_own_names_and_its_status_is_no_failsafe(tmp_path):
    rows = changed(mavros_rows(state_hz=10.0, mode="GUIDED"), system_status=5, mode="LAND")
    _, path = proposed(tmp_path, write_bag(tmp_path / "x.bag", rows))
    assert "failsafe" not in load_map(path).readings
    outcome, _ = replay(tmp_path / "x.bag", path)
    taken = next(d for d in outcome.decisions if d.after == "PILOT")
    assert {value.name: value.value for value in taken.values}["flight mode"] == "AUTO.LAND"


def test_what_the_autopilot_says_in_words_are_lines_with_their_severity(tmp_path):
    if "mavros_msgs/msg/StatusText" not in STORE.types:
        text = "std_msgs/Header header\nuint8 severity\nstring text\n"
        STORE.register(get_types_from_msg(text, "mavros_msgs/msg/StatusText"))
    rows = mavros_rows()
    for t_s, severity, words in ((7.5, 6, "Armed by RC\x07"), (20.0, 4, "Low battery"), (26.0, 2, "Failsafe")):
        at = START_NS + round(t_s * S)
        said = make("mavros_msgs/msg/StatusText", header=header(at), severity=severity, text=words)
        rows.append((at, "/mavros/statustext/recv", said))
    bag = write_bag(tmp_path / "x.bag", sorted(rows, key=lambda row: row[0]))
    for name in ("mavros", proposed(tmp_path, bag)[1]):
        outcome, _ = replay(bag, name)
        said = [line for line in outcome.timeline if "says" in line.text]
        assert [(line.text, line.level) for line in said] == [
            ("the autopilot says: Armed by RC", 0),
            ("the autopilot says: Low battery", 1),
            ("the autopilot says: Failsafe", 2),
        ]


def test_plain_sensors_are_selected_by_the_lift_off_that_the_range_shows(tmp_path):
    bag = write_bag(tmp_path / "x.bag", [row for row in flight_rows() if row[1] in ("/imu", "/range", "/battery")])
    proposal, path = proposed(tmp_path, bag)
    assert [text for text in proposal.found if "lift-off" in text] == ["lift-off by the range: +8.2 s"]
    assert "armed" in proposal.scripted
    outcome, _ = replay(bag, path)
    assert states(outcome)[:6] == NOMINAL[:6]


def test_an_accelerometer_in_g_and_a_battery_in_percent_are_scaled(tmp_path):
    rows = [(t, topic, message) for t, topic, message in flight_rows(10.0) if topic in ("/imu", "/battery")]
    for _, topic, message in rows:
        if topic == "/imu":
            message.linear_acceleration.z /= 9.80665
        else:
            message.percentage = 80.0
    _, path = proposed(tmp_path, write_bag(tmp_path / "x.bag", rows))
    found = load_map(path).readings
    assert (found["imu"].scale, found["battery"].scale) == (9.80665, 0.01)


def test_a_battery_without_a_level_is_left_to_the_script_and_that_is_said(tmp_path):
    rows = [row for row in flight_rows(10.0, fraction=float("nan")) if row[1] in ("/imu", "/battery")]
    proposal, path = proposed(tmp_path, write_bag(tmp_path / "x.bag", rows))
    assert "battery" not in load_map(path).readings
    assert any(text.startswith("/battery tells no level (nan)") for text in proposal.found)


def test_the_command_writes_a_map_that_runs(tmp_path, capsys):
    bag = write_bag(tmp_path / "x.bag", mavros_rows())
    out = tmp_path / "mine.yaml"
    assert main(["map", str(bag), "--out", str(out)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"written: {out}"
    assert main(["map", str(bag)]) == 0
    assert capsys.readouterr().out == out.read_text()
    assert main(["run", str(bag), "--map", str(out)]) == 0
    assert "amaze-replay map" in Path(out).read_text()


def test_a_map_replaces_neither_a_recording_nor_a_map_that_was_edited(tmp_path, capsys):
    bag, out = write_bag(tmp_path / "x.bag", mavros_rows()), tmp_path / "mine.yaml"
    before = bag.read_bytes()
    (tmp_path / "linked.yaml").symlink_to(bag)
    for name in (bag, tmp_path / "linked.yaml"):
        assert main(["map", str(bag), "--out", str(name)]) == 2
        said = "is one of the inputs, which are never changed; name another file with --out"
        assert capsys.readouterr().err == f"amaze-replay: {name}: {said}\n"
    assert bag.read_bytes() == before
    out.write_text("")
    for _ in range(2):  # an empty file, and the same map again
        assert main(["map", str(bag), "--out", str(out)]) == 0
    edited = out.read_text() + "# and the camera\n"
    out.write_text(edited)
    capsys.readouterr()
    assert main(["map", str(bag), "--out", str(out)]) == 2
    said = "differs from this proposal, and would be replaced; name another file with --out, or delete that one"
    assert capsys.readouterr() == ("", f"amaze-replay: {out}: {said}\n")
    assert out.read_text() == edited
    assert main(["map", str(bag), "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"amaze-replay: {tmp_path}: is a folder; name a file with --out\n"


def test_a_recording_without_a_vehicle_is_said_to_be_that(tmp_path, capsys):
    rows = [(START_NS + each * S, "/turtle", make("std_msgs/msg/Bool", data=True)) for each in range(5)]
    bag, out = write_bag(tmp_path / "x.bag", rows), tmp_path / "x.yaml"
    assert main(["map", str(bag), "--out", str(out)]) == 0
    words = (
        "no vehicle: no topic tells of sensors or an autopilot (std_msgs/Bool); name the recording of a vehicle, or "
        "write a map by hand (docs/replay.md, Writing a topic map)"
    )
    assert capsys.readouterr().out.splitlines()[0] == words
    assert f"# What was found:\n#   {words}\n" in out.read_text()
    assert main(["run", str(bag), "--map", str(out)]) == 2
    assert "x.bag: the map names none of its topics; there are /turtle" in capsys.readouterr().err


# --- the CNS Flight Stack ---------------------------------------------------------------------------------------------


def cns(kind, **fields):
    """Return a message of the CNS Flight Stack, by the definitions of CNS.md."""
    for name, text in MESSAGES.items():
        package, short = name.split("/")
        if f"{package}/msg/{short}" not in STORE.types:
            STORE.register(get_types_from_msg(text, f"{package}/msg/{short}"))
    package, short = kind.split("/")
    return make(f"{package}/msg/{short}", **fields)


def entity(name, status, info=""):
    return cns("watchdog_msgs/Status", entity=name, type=1, status=status, name=f"/{name}", info=info)


def cns_rows(silent_s=99.0, mission=1):
    """Return what its nodes say of the flight of `mavros_rows`: the sequencer's answers, events, and a slow heartbeat.

    The heartbeat comes at 0.5 Hz until `silent_s`; at 20 s the entity `Event-Camera 1` has an error.
    """
    rows = []

    def say(t_s, topic, message):
        rows.append((START_NS + round(t_s * S), topic, message))

    def answer(t_s, request, response, completed):
        at = START_NS + round(t_s * S)
        asked = cns("mission_sequencer/MissionRequest", header=header(at), id=mission, request=request)
        say(t_s - 0.01, "/autonomy/request", asked)
        fields = {"request": asked, "response": response, "completed": completed}
        say(t_s, "/autonomy/response", cns("mission_sequencer/MissionResponse", header=header(at), **fields))

    for second in range(0, 36, 2):
        if second < silent_s:
            status = entity("", 1 if second < 20 else 8)
            at = header(START_NS + second * S)
            say(second, "/watchdog/status", cns("watchdog_msgs/StatusStamped", header=at, status=status))
    for t_s, status in ((0.1, 1), (20.0, 8)):
        each = [entity("Event-Camera 1", status, "no messages")]
        data = cns("watchdog_msgs/StatusChangesArray", changes=each, current=each)
        at = header(START_NS + round(t_s * S))
        say(t_s, "/watchdog/log", cns("watchdog_msgs/StatusChangesArrayStamped", header=at, data=data))
    for t_s, name in ((8.5, "is_takeoff"), (30.2, "is_landed")):
        say(t_s, f"/toland_detector/{name}", make("std_msgs/msg/Bool", data=True))
    answer(7.0, 1, response=True, completed=False)  # ARM
    answer(8.0, 1, response=False, completed=True)
    answer(8.1, 2, response=True, completed=False)  # TAKEOFF
    answer(10.5, 2, response=False, completed=True)
    answer(25.5, 0, response=False, completed=True)  # the last waypoint
    answer(25.6, 5, response=True, completed=False)  # LAND
    answer(30.5, 5, response=False, completed=True)
    answer(31.9, 8, response=False, completed=True)  # DISARM
    return rows


def cns_flight(tmp_path, **more):
    rows = sorted([*mavros_rows(), *cns_rows(**more)], key=lambda row: row[0])
    return write_bag(tmp_path / "cns.bag", rows)


def statuses(path, topic):
    """Return when a status that was made says something else, and what."""
    (made,) = [bag for bag in recordings_of(path) if f"/cns/{topic}" in {each.name for each in bag.topics}]
    return [((entry.t_ns - START_NS) / S, made.message(entry)) for entry in made.entries(f"/cns/{topic}")]


def changes_of(values):
    return [each for each, before in zip(values, [(None, None), *values]) if each[1] != before[1]]


def test_of_the_time_between_two_settings_of_a_clock_nothing_is_made(tmp_path):
    """Else there would be thirteen million statuses."""
    month_s = 30 * 24 * 3600
    rows = cns_rows()
    later = [(t_ns + month_s * S, *rest) for t_ns, *rest in rows]
    bag = write_bag(tmp_path / "x.bag", sorted([*rows, *later], key=lambda row: row[0]))
    for topic in ("landing_detection", "mission_planner"):
        (made,) = [each for each in recordings_of(bag) if f"/cns/{topic}" in {named.name for named in each.topics}]
        times = [(entry.t_ns - START_NS) / S for entry in made.entries(f"/cns/{topic}")]
        assert 100 < len(times) < 1000
        assert [t_s for t_s in times if 40 < t_s < month_s] == []


def test_a_flight_of_the_cns_flight_stack_gives_statuses_of_ours_by_the_proposed_map(tmp_path):
    bag = cns_flight(tmp_path)
    proposal, path = proposed(tmp_path, bag)
    assert load_map(path).statuses == {
        "landing_detection": "/cns/landing_detection",
        "mission_planner": "/cns/mission_planner",
        "watchdog_action": "/cns/watchdog_action",
        "watchdog_info": "/cns/watchdog_info",
    }
    assert proposal.scripted == ("data recorder",)
    assert [text for text in proposal.found if text.startswith("CNS")] == [
        "CNS /autonomy/request: not mapped: each answer says what was asked",
        "CNS /autonomy/response: answers of its sequencer: mission_planner",
        "CNS /toland_detector/is_landed: its landing detector: landing_detection",
        "CNS /toland_detector/is_takeoff: its landing detector: landing_detection",
        "CNS /watchdog/log: entities of its watchdog: watchdog_info and watchdog_action; an error counts as severity "
        "high",
        "CNS /watchdog/status: heartbeat of its watchdog: watchdog_action",
        "CNS missions that were asked for: 1 (run --mission)",
        "CNS state check, start and stop of the recorder: not mapped, they are services, of which no topic tells",
    ]
    outcome = _replayed(bag, path)
    assert states(outcome)[:6] == NOMINAL[:6]
    held = next(d for d in outcome.decisions if d.after == "HOLD")
    assert 20.0 <= (held.t_ns - START_NS) / S < 20.3
    assert {value.name: value.value for value in held.values}["failure"] == "event_camera_1"


def test_phases_are_those_of_the_sequencers_answers(tmp_path):
    said = statuses(cns_flight(tmp_path), "mission_planner")
    phases = changes_of([(t_s, MissionPhase(message.phase).name) for t_s, message in said])
    assert phases == [
        (0.0, "LOADED"), (7.0, "TAKING_OFF"), (10.5, "FLYING"), (25.6, "LANDING"), (31.9, "LANDED"),
    ]  # fmt: skip
    assert {message.mission_id for _, message in said} == {"1"}


def test_the_landing_detectors_events_are_a_level(tmp_path):
    said = [(t_s, Landed(message.landed).name) for t_s, message in statuses(cns_flight(tmp_path), "landing_detection")]
    assert changes_of(said) == [(0.0, "ON_GROUND"), (8.5, "AIRBORNE"), (30.2, "ON_GROUND")]


def test_a_heartbeat_of_half_a_hertz_is_enough_for_ours_until_it_is_silent(tmp_path):
    said = statuses(cns_flight(tmp_path, silent_s=13.0), "watchdog_action")
    assert max(after - before for (before, _), (after, _) in zip(said, said[1:])) == pytest.approx(0.2)
    assert said[-1][0] == pytest.approx(12.0 + 5.0)


@pytest.mark.parametrize("later_s", [0.0, 0.002, 0.15])
@pytest.mark.parametrize("first", ["/watchdog/log", "/watchdog/status"])
def test_an_entity_that_fails_and_comes_back_holds_for_itself_and_for_nothing_else(tmp_path, first, later_s):
    """Its watchdog says both on two topics, of which either may be recorded first."""
    moved = {"/watchdog/log": 0.0, "/watchdog/status": later_s if first == "/watchdog/log" else -later_s}
    rows = [row for row in cns_rows() if not row[1].startswith("/watchdog")]
    for half in range(2, 70):
        status = 8 if 20 <= half < 30 else 1
        message = cns("watchdog_msgs/StatusStamped", header=header(START_NS), status=entity("", status))
        rows.append((START_NS + half * S // 2 + round(moved["/watchdog/status"] * S), "/watchdog/status", message))
        if half in (2, 20, 30):
            each = [entity("Event-Camera 1", status, "no messages")]
            data = cns("watchdog_msgs/StatusChangesArray", changes=each, current=each)
            message = cns("watchdog_msgs/StatusChangesArrayStamped", header=header(START_NS), data=data)
            rows.append((START_NS + half * S // 2, "/watchdog/log", message))
    rows.sort(key=lambda row: (row[0], row[1] != first))
    said = statuses(write_bag(tmp_path / "x.bag", rows), "watchdog_action")
    failing = changes_of([(t_s, tuple(row.name for row in message.components)) for t_s, message in said])
    assert [names for _, names in failing] == [(), ("event_camera_1",), ()]
    assert [t_s for t_s, _ in failing[1:]] == [pytest.approx(10.0), pytest.approx(15.0)]


def test_an_error_that_no_log_of_the_recording_explains_counts_from_the_second_heartbeat(tmp_path):
    rows = [row for row in cns_rows() if row[1] != "/watchdog/log" or row[0] < START_NS + 20 * S]
    said = statuses(write_bag(tmp_path / "x.bag", rows), "watchdog_action")
    failing = changes_of([(t_s, tuple(row.name for row in message.components)) for t_s, message in said])
    assert failing[1:] == [(pytest.approx(22.0), ("cns_watchdog",))]  # it beats every two seconds


def test_a_type_of_another_definition_is_left_out_by_name(tmp_path):
    rows = [row for row in cns_rows() if row[1] == "/watchdog/status"]
    bag = write_bag(tmp_path / "x.bag", [*mavros_rows(), *rows])
    good = TOPICS["heartbeat"].md5.encode()
    assert bag.read_bytes().count(good) == 2
    bag.write_bytes(bag.read_bytes().replace(good, b"0" * 32))
    proposal, path = proposed(tmp_path, bag)
    assert "CNS /watchdog/status: not mapped: its definition is another one than is known" in proposal.found
    assert load_map(path).statuses == {}


def test_a_bag_without_messages_is_one_clear_error():
    with pytest.raises(NoMessagesError, match=r"no_messages.bag: there is no message in it$"):
        propose([recording("no_messages.bag")])


REAL = {
    "ardrone_indoor_flight.bag": ["MISSION", "LAND"],
    "crazyflie_sine.bag": ["TAKEOFF"],
    "px4_normal_mission.tlog": ["TAKEOFF", "MISSION", "MISSION_ENDED"],
    "px4_offboard.tlog": ["TAKEOFF", "MISSION", "PILOT"],
    "husky_outdoor_drive.bag": ["OUTREACH"],
    "handheld_roll_pitch_yaw.bag": ["READY", "OUTREACH"],
    "copter_low_battery.tlog": ["PILOT"],
}


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("name", REAL)
def test_a_real_recording_comes_to_its_states_by_the_proposed_map(tmp_path, name):
    path = recording(name)
    _, found = proposed(tmp_path, path)
    outcome = _replayed(path, found)
    assert [state for state in states(outcome) if state in REAL[name]][: len(REAL[name])] == REAL[name]


def _replayed(path, found):
    plan = make_plan(load_configuration(CONFIG), load_map(found), "1", topics_of([path]))
    with Recordings([path], plan.topics) as recordings:
        return Session(plan, recordings).run()


def test_topics_of_the_running_graph_whose_package_is_not_here_or_another_one_are_named(monkeypatch):
    graph = pytest.importorskip("amaze_autonomy.ros.graph", reason="needs ROS")
    monkeypatch.setattr(graph.rospy, "get_time", lambda: 0.0)
    heard = graph.Heard()
    for name, kind in (("/other/state", "other_msgs/State"), ("/short", "std_msgs/Float64")):
        heard.take(name, SimpleNamespace(_connection_header={"type": kind}, _buff=b"abc"))
    found = propose_of([heard], [Path("the running graph")]).found
    assert "/other/state: cannot be read (other_msgs/State is of a package that is not here)" in found
    assert "/short: cannot be read (std_msgs/Float64 is of another version here)" in found
