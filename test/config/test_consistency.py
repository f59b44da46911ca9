"""What must be true between files, and between names and what they name."""

from __future__ import annotations

import pytest

from amaze_autonomy.config import load_configuration
from amaze_autonomy.config.consistency import contradictions, taken_in_place, unnamed_topics, unrecorded_topics
from amaze_autonomy.config.trajectories import low_batteries
from amaze_autonomy.monitoring.specs import RestartPolicy
from amaze_autonomy.paths import config_folder


def test_a_restart_must_end_before_the_fix_is_given_up(mistake, small_file):
    text = small_file("sensors.yaml").replace("{policy: node}", "{policy: node, total_limit_s: 61.0}")
    assert mistake("sensors.yaml", text) == (
        "sensors.yaml:13: components.camera.restart.total_limit_s: is 61; "
        "must be at most checks.preflight_fix_limit_s of autonomy.yaml (60), or it is not waited for"
    )


def test_no_more_components_are_watched_than_a_message_lists(mistake, small_file):
    """What is cut off would be missing among what a mission requires."""
    rows = "".join(f"  c{number}: {{group: px4, severity: low, autopilot: gps}}\n" for number in range(99))
    assert mistake("sensors.yaml", small_file("sensors.yaml") + rows) == (
        "sensors.yaml:1: components: has 101; must have at most 100: a message lists no more"
    )


OF_BOTH = r"of . [a-z] [^/] (a|b) * + ? {2} \d \w alone, which rosbag and Python read alike"
NEEDED = "must be another one, or another node: %s, and is never ended: the vehicle would be uncontrollable"


@pytest.mark.parametrize(
    "node, why",
    [
        ("/mavros", "/mavros is a node of local_position, of the PX4"),
        ("/autopilot", "/autopilot is a node of this stack"),
        ("/left/mission_planner", "/left/mission_planner is a node of this stack"),
        ("/data_recorder_main", "/data_recorder_main is a node of this stack"),
        ("/link", "/link is mavros, the link to the vehicle"),
    ],
)
def test_a_node_that_the_vehicle_needs_is_not_restarted_for_another_component(mistake, small_file, small, node, why):
    (small / "autopilot.yaml").write_text("backend: mavros\nmavros: /link\n")
    text = small_file("sensors.yaml").replace("/camera\n", f"{node}\n")
    text += "  local_position:\n    group: px4\n    severity: highest\n    node: /mavros\n"
    wrong = f"sensors.yaml:13: components.camera.restart.policy: is node; {NEEDED % why}"
    assert mistake("sensors.yaml", text) == wrong


def test_a_node_that_the_vehicle_needs_may_be_watched_by_all(small, small_file):
    text = small_file("sensors.yaml").replace("/camera\n", "/mavros\n").replace("    restart: {policy: node}\n", "")
    text += "  local_position:\n    group: px4\n    severity: highest\n    node: /mavros\n"
    (small / "sensors.yaml").write_text(text)
    assert [spec.node for spec in load_configuration(small).components] == [None, "/mavros", "/mavros"]


def test_where_the_link_is_not_mavros_its_name_is_anybodys(small):
    (small / "autopilot.yaml").write_text("backend: mavlink\nmavros: /camera\n")
    assert load_configuration(small).components[1].restart.policy is RestartPolicy.NODE


def test_no_takeoff_at_a_critical_battery(mistake, small_file):
    text = small_file("sensors.yaml") + "battery:\n  minimum_fraction: 0.1\n"
    assert mistake("sensors.yaml", text) == (
        "sensors.yaml:15: battery.minimum_fraction: is 0.1; "
        "must be at least battery.battery_critical_fraction of autonomy.yaml (0.15): it would land at once"
    )


def test_a_landing_from_the_height_limit_must_fit_its_time(mistake, small_file):
    text = small_file("missions.yaml") + "flight: {landing_speed_m_s: 0.2}\n"
    assert mistake("missions.yaml", text) == (
        "missions.yaml:5: flight.landing_speed_m_s: is 0.2; "
        "must be at least 0.25: else landing from 30 m takes longer than 120 s"
    )


def test_a_landing_from_the_height_limit_of_a_mission_must_fit_its_time(mistake, small_file):
    text = small_file("missions.yaml") + "    limits: {max_height_m: 80.0}\n"
    assert mistake("missions.yaml", text) == (
        "missions.yaml:5: missions.1.limits.max_height_m: is 80; "
        "must be at most 60: landing takes longer than 120 s (land_limit_s)"
    )


def test_a_climb_must_fit_the_time_of_a_takeoff(mistake, small, small_file):
    (small / "up.csv").write_text("# frame: east_north\nx,y,z,yaw_rad,holdtime\n0,0,20,0,1\n")
    text = small_file("missions.yaml") + "flight: {climb_speed_m_s: 0.5}\n"
    assert mistake("missions.yaml", text, ["autonomy.takeoff.takeoff_height_m=20"]) == (
        "missions.yaml:5: flight.climb_speed_m_s: is 0.5; must be more: "
        "the climb to 20 m (takeoff_height_m) takes 40.5 s, and is ended after 30 s (takeoff_limit_s)"
    )


def test_set_points_are_led_for_less_than_the_time_of_the_arming(mistake, small, small_file):
    text = small_file("missions.yaml") + "    controller: %s\nplanner: {setpoint_lead_s: 6}\n"
    assert mistake("missions.yaml", text % "offboard") == (
        "missions.yaml:6: planner.setpoint_lead_s: is 6; must be at most 5, half of takeoff.arm_limit_s of "
        "autonomy.yaml (10): it is armed after that"
    )
    (small / "missions.yaml").write_text(text % "mission")
    assert load_configuration(small).planner.setpoint_lead_ns == 6_000_000_000


def test_a_mission_needs_something_before_takeoff(mistake, small_file):
    overrides = [f"sensors.components.{name}.required=false" for name in ("gps", "camera")]
    assert mistake("missions.yaml", small_file("missions.yaml"), overrides) == (
        "missions.yaml:2: missions.1.required: is empty, and every component of sensors.yaml has required: false; "
        "must list what must work before takeoff, or one of those must be required"
    )


@pytest.mark.parametrize(
    "line, message",
    [
        ("required: [gsp]", "required.0: gsp is not a component of sensors.yaml; did you mean gps?"),
        ("required: [Gps]", "required.0: Gps is not a component of sensors.yaml; did you mean gps?"),
        ("tolerated: [the-camera]", "tolerated.0: the-camera is not a component of sensors.yaml; did you mean camera?"),
        ("tolerated: [gps, lidar]", "tolerated.1: lidar is not a component of sensors.yaml; known: gps, camera"),
        (
            "severities: {cameras: low}",
            "severities.cameras: cameras is not a component of sensors.yaml; did you mean camera?",
        ),
        (
            "severities: {camera: bad}",
            "severities.camera: is the text 'bad'; must be one of low, moderate, high, highest",
        ),
        (
            "{required: [gps, camera], tolerated: [camera]}",
            "tolerated.0: camera is required as well; "
            "must be in one of them: a required component must be at code 1, a tolerated one may be at code 2",
        ),
        (
            "battery_needed_fraction: 0.2",
            "battery_needed_fraction: is 0.2; must be above the reserve, which it includes (0.2)",
        ),
        (
            "limits: {max_flight_time_s: 10.0}",
            "limits.max_flight_time_s: its longest flight takes 14 s; must be below max_flight_time_s (10)",
        ),
    ],
)
def test_a_mission_that_cannot_be_is_refused(mistake, small_file, line, message):
    text = small_file("missions.yaml")
    text += f"    {line}\n" if not line.startswith("{") else "    " + line[1:-1].replace("], ", "]\n    ") + "\n"
    number = len(text.splitlines())
    assert mistake("missions.yaml", text) == f"missions.yaml:{number}: missions.1.{message}"


def test_a_wait_that_a_mission_alone_has_is_long_enough_as_well(mistake, small, small_file):
    slow = "  camera:\n    group: other\n    severity: low\n    topics: {/image: {rate_hz: 0.2, age_limit_s: 15}}\n"
    (small / "sensors.yaml").write_text(small_file("sensors.yaml").split("  camera")[0] + slow)
    text = small_file("missions.yaml") + "    severities: {camera: high}\n"
    assert mistake("missions.yaml", text) == (
        "missions.yaml:5: missions.1.severities.camera: is high; must be one that is not waited for, or "
        "commands.unlisted_wait_limit_s of autonomy.yaml (15) must be above 25: so long it takes until "
        "/image at 0.2 Hz (good_samples: 5) counts as back"
    )
    assert load_configuration(small, ["autonomy.commands.unlisted_wait_limit_s=26"]).plans
    assert load_configuration(small, ["missions.missions.1.severities.camera=highest"]).plans


def test_a_mission_that_no_battery_is_enough_for_is_refused(mistake, small_file):
    text = small_file("missions.yaml") + "    repetitions: 100\n"
    assert mistake("missions.yaml", text) == (
        "missions.yaml:2: missions.1: needs 1.60 of the battery (1400 s of 1000 s, and reserve); "
        "must need at most 1: fly less, or in parts"
    )


def test_a_mission_that_flies_longer_than_a_battery_lasts_is_refused_whatever_it_says_to_need(mistake, small_file):
    text = small_file("missions.yaml") + "    battery_needed_fraction: 0.3\nflight: {endurance_s: 13}\n"
    assert mistake("missions.yaml", text) == (
        "missions.yaml:5: missions.1.battery_needed_fraction: is 0.3, and it flies for 14 s in all; "
        "must be flown in less than flight.endurance_s (13): fly less, or in parts"
    )


@pytest.mark.parametrize("given, says", [("", False), ("0.3", True), ("0.34", False), ("0.5", False)])
def test_a_battery_below_what_is_estimated_is_said(small, small_file, given, says):
    text = small_file("missions.yaml") + "    repetitions: 10\n"
    (small / "missions.yaml").write_text(text + (f"    battery_needed_fraction: {given}\n" if given else ""))
    assert low_batteries(load_configuration(small)) == says * [
        "missions.yaml: mission 1 says battery_needed_fraction 0.3, and 0.34 is what 140 s of flight.endurance_s "
        "(1000) and the reserve are: have you measured it?"
    ]


def test_what_ships_says_no_battery_below_what_is_estimated():
    assert low_batteries(load_configuration(config_folder())) == []


def test_a_flight_longer_than_the_limit_of_all_flights_is_refused(mistake, small_file):
    overrides = ["autonomy.flight.max_flight_time_s=13.0", "autonomy.commands.user_hold_limit_s=5.0"]
    assert mistake("missions.yaml", small_file("missions.yaml"), overrides) == (
        "missions.yaml:2: missions.1: its longest flight takes 14 s; must be below max_flight_time_s (13)"
    )


@pytest.mark.parametrize(
    "folder", ["recordings", "./recordings", "~somebody/recordings", '"~"', '""', '" /recordings"']
)
def test_recordings_are_in_the_same_folder_for_whoever_looks(mistake, small_file, folder):
    text = small_file("recording.yaml").replace("~/recordings", folder)
    plain = folder.strip('"')
    assert mistake("recording.yaml", text) == (
        f"recording.yaml:1: folder: is the text {plain!r}; "
        'must be a whole path of a folder, or one in the home, e.g. "~/recordings"'
    )


@pytest.mark.parametrize("folder", ["/recordings", "~/recordings", "/media/Käfer & Söhne"])
def test_recordings_are_in_a_whole_path_or_in_the_home(small, small_file, folder):
    text = small_file("recording.yaml").replace("~/recordings", folder)
    (small / "recording.yaml").write_text(text, encoding="utf-8")
    assert load_configuration(small).recording.folder == folder


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("collector: main", "collector: Main", "2: collector: Main is not a platform; did you mean main?"),
        ("groups: [all]", "groups: [All]", "4: platforms.main.groups.0: All is not a group; did you mean all?"),
        ("collector: main", "collector: man", "2: collector: man is not a platform; did you mean main?"),
        ("groups: [all]", "groups: [al]", "4: platforms.main.groups.0: al is not a group; did you mean all?"),
        (
            "[/camera/image]",
            "[camera image]",
            "6: groups.all.topics.0: is the text 'camera image'; "
            'must be the name of a topic, e.g. "/lrf/range"; "~" stands for the autonomy node',
        ),
        (
            "collector: main\nplatforms:\n  main:",
            "collector: up-board\nplatforms:\n  up-board:",
            "4: platforms.up-board: is not a good name; must match [a-z][a-z0-9_]{0,63}",
        ),
        ("[/camera/image]", "[]", "6: groups.all.topics: is an empty list; must be a list of topics, at least 1"),
        (
            "  all: {topics: [/camera/image]}",
            "  all: {topics: [/camera/image]}\n  more: {topics: [/imu]}",
            "7: groups.more: is recorded by no platform; must be in the groups of one",
        ),
        (
            "  main: {groups: [all]}",
            "  main: {groups: [all]}\n  second: {groups: [all]}",
            "7: groups.all.topics.0: /camera/image is recorded by main in all and by second in all; "
            "must be recorded once: the merged recording would have it twice",
        ),
        (
            "  main: {groups: [all]}",
            "  main: {groups: [all], transfer: {by: rsync}}",
            "4: platforms.main.transfer.host: is missing; must be given for rsync: the other computer, as ssh knows it",
        ),
        (
            "folder: ~/recordings",
            "folder: ~/recordings\ntolerated_topics: [/camera/imag]",
            "2: tolerated_topics.0: /camera/imag is recorded by no group; did you mean /camera/image?",
        ),
        (
            "folder: ~/recordings",
            "folder: ~/recordings\nstart_limit_s: 15",
            "2: start_limit_s: is 15; must be below recording.recording_start_limit_s of autonomy.yaml (15), "
            "or nobody hears why",
        ),
        (
            "{topics: [/camera/image]}",
            '{topics: [/camera/image], match: ["/x.*"], exclude: ".*image"}',
            "6: groups.all.topics.0: /camera/image is excluded by .*image; must not be: it would not be recorded",
        ),
        (
            "{topics: [/camera/image]}",
            '{topics: [lrf/range], match: ["/x.*"], exclude: "/lrf/.*"}',
            "6: groups.all.topics.0: lrf/range is excluded by /lrf/.*; must not be: it would not be recorded",
        ),
        (
            "{topics: [/camera/image]}",
            '{topics: [/camera/image], match: ["/x.*", "*/image"]}',
            "6: groups.all.match.1: is the text '*/image' (nothing to repeat at position 0); "
            "must be a regular expression of topic names, " + OF_BOTH,
        ),
        (
            "{topics: [/camera/image]}",
            '{topics: [/camera/image], exclude: "/camera/(.*"}',
            "6: groups.all.exclude: is the text '/camera/(.*' (missing ), unterminated subpattern at position 8); "
            "must be a regular expression of topic names, " + OF_BOTH,
        ),
        (
            "{topics: [/camera/image]}",
            "{topics: [/camera/image], match: ['/camera/(?|image|info)']}",
            "6: groups.all.match.0: is the text '/camera/(?|image|info)' (unknown extension ?| at position 9); "
            "must be a regular expression of topic names, " + OF_BOTH,
        ),
        (
            "{topics: [/camera/image]}",
            "{topics: [/camera/image], match: ['/[[:alpha:]]+']}",
            "6: groups.all.match.0: is the text '/[[:alpha:]]+' ([: is another thing to Python than to rosbag); "
            "must be a regular expression of topic names, " + OF_BOTH,
        ),
        ("folder: ~/recordings", "folders: ~/x", "1: folders: is an unknown key; did you mean folder?"),
        (
            "folder: ~/recordings",
            "folder: ~/recordings\nstorage: {min_free_fraction: 1.0}",
            "2: storage.min_free_fraction: is 1.0; must be a number at least 0 and below 1, as a fraction of 1",
        ),
        (
            "folder: ~/recordings",
            "folder: ~/recordings\nstorage: {compression: bz2}",
            "2: storage.compression: is the text 'bz2'; must be one of none, lz4",
        ),
    ],
)
def test_a_recording_that_cannot_be_is_refused(mistake, small_file, old, new, message):
    assert mistake("recording.yaml", small_file("recording.yaml").replace(old, new)) == f"recording.yaml:{message}"


TWO = """\
folder: ~/recordings
collector: main
platforms:
  main: {groups: [all]}
  second: {groups: [more]TRANSFER}
groups:
  all: {topics: [/camera/image]}
  more: {topics: [/px4/imu]}
"""
IN_PLACE = (
    "platforms.second of recording.yaml does not say how main gets its recordings (transfer.by), which are used in "
    "place then: is its folder on a disk of main? If so, write `transfer: {by: here}`, else rsync or shared"
)


@pytest.mark.parametrize(
    "transfer, overrides, expected",
    [
        ("", (), [IN_PLACE]),
        (", transfer: {host: second}", (), [IN_PLACE]),
        (", transfer: {by: here}", (), []),
        (", transfer: {by: rsync, host: second}", (), []),
        (", transfer: {by: shared}", (), []),
        ("", ("recording.platforms.second.transfer.by=here",), []),
    ],
)
def test_a_platform_whose_recordings_are_used_in_place_says_so_itself(small, transfer, overrides, expected):
    (small / "recording.yaml").write_text(TWO.replace("TRANSFER", transfer))
    assert taken_in_place(load_configuration(small, overrides).recording) == expected


def test_the_collector_gets_its_own_recordings_from_nobody(small):
    assert taken_in_place(load_configuration(small).recording) == []


def watched(folder, recording, sensors=""):
    (folder / "recording.yaml").write_text(
        (folder / "recording.yaml").read_text().replace("{topics: [/camera/image]}", recording)
    )
    (folder / "sensors.yaml").write_text((folder / "sensors.yaml").read_text() + sensors)
    effective = load_configuration(folder).effective
    return [line.split(" is watched")[0] for line in unrecorded_topics(effective["sensors"], effective["recording"])]


CHECKED = [
    "/lrf/range (landing_detection.topic)",
    "/odometry (state_estimation.topic)",
    "/px4/imu (state_estimation.imu_topic)",
]


def test_the_autopilot_node_answers_before_the_engine_stops_waiting(mistake):
    assert mistake("autopilot.yaml", "backend: mavlink\ncommands: {reply_s: 1.0}\n") == (
        "autopilot.yaml:2: commands.reply_s: is 1; "
        "must be below commands.command_reply_limit_s of autonomy.yaml (1), or no answer comes in time"
    )


def test_the_recorder_of_which_the_file_says_nothing_has_its_own_limit_as_well(mistake, small):
    assert mistake("autonomy.yaml", "recording:\n  recording_start_limit_s: 12\n") == (
        "autonomy.yaml:2: recording.recording_start_limit_s: is 12; "
        "must be above start_limit_s of recording.yaml (12), or nobody hears why"
    )
    text = (small / "recording.yaml").read_text() + "start_limit_s: 11\n"
    (small / "recording.yaml").write_text(text)
    assert load_configuration(small).recording.start_limit_ns == 11_000_000_000


def test_a_platform_is_not_silent_between_two_of_its_statuses(mistake, small, small_file):
    recording = small_file("recording.yaml") + "platform_limit_s: 1.9\n"
    rate = ["autonomy.streams.recorder_status_rate_hz=1"]
    assert mistake("recording.yaml", recording, rate) == (
        "recording.yaml:7: platform_limit_s: is 1.9; must be at least 2, 2 periods of streams.recorder_status_rate_hz "
        "of autonomy.yaml: one lost message is no loss"
    )
    (small / "recording.yaml").write_text(recording.replace("1.9", "2.0"))
    assert load_configuration(small, rate).recording.platform_limit_ns == 2_000_000_000


def test_an_estimator_that_must_be_told_to_begin_has_less_time_than_the_checks(mistake, small, small_file):
    sensors = small_file("sensors.yaml") + "initialisation: {limit_s: 60.0}\n"
    (small / "sensors.yaml").write_text(sensors)
    load_configuration(small)  # none is asked, and nobody waits
    assert mistake("sensors.yaml", sensors, ["sensors.initialisation.service=/init"]) == (
        "sensors.yaml:14: initialisation.limit_s: is 60; "
        "must be below checks.preflight_fix_limit_s of autonomy.yaml (60), or it is not waited for"
    )


@pytest.mark.parametrize(
    "group, expected",
    [
        ("{topics: [/camera/image]}", CHECKED),
        ("{topics: [/other, /camera/imag]}", ["/camera/image (component camera)", *CHECKED]),
        ('{topics: [/a], match: ["/camera/.*"]}', CHECKED),
        ('{topics: [/a], match: ["/camera"]}', ["/camera/image (component camera)", *CHECKED]),
        ('{topics: [/a], match: [".*"], exclude: ".*/image"}', ["/camera/image (component camera)"]),
        ('{topics: [/a], match: [".*"], exclude: "image"}', []),
        ('{topics: [/camera/image], exclude: ".*/image"}', CHECKED),
        ('{topics: [/camera/image], match: ["/lrf/.*", "/odometry"]}', ["/px4/imu (state_estimation.imu_topic)"]),
    ],
)
def test_what_is_watched_and_not_recorded_is_said(small, group, expected):
    assert watched(small, group) == expected


def test_checks_that_look_at_no_topic_have_none_to_record(small):
    sensors = 'state_estimation: {topic: "", imu_topic: /px4/imu}\n'
    assert watched(small, "{topics: [/camera/image, /lrf/range]}", sensors) == ["/px4/imu (state_estimation.imu_topic)"]


LRF = """\
  lrf:
    group: other
    severity: low
    topics:
      /lrf/range: {rate_hz: 10.0, age_limit_s: LIMIT}
"""


@pytest.mark.parametrize(
    "limit, group, overrides, expected",
    [
        ("0.5", "[/camera/image, /lrf/range]", (), []),
        ("10.0", "[/camera/image, /lrf/range]", (), []),
        (
            "400.0",
            "[/camera/image, /lrf/range]",
            (),
            [
                "components.lrf: /lrf/range may be silent for 400 s, 4000 periods of its 10 Hz, before it has failed: "
                "is age_limit_s what you mean?"
            ],
        ),
        (
            "0.5",
            "[/camera/image, /lrf/range]",
            ("sensors.landing_detection.topic=/lrf/ranges",),
            [
                "landing_detection.topic is /lrf/ranges, and no component has that topic: nobody says when it fails; "
                "add it to a component, or name the topic that one has; did you mean /lrf/range?"
            ],
        ),
        (
            "0.5",
            "[/camera/image, /lrf/range]",
            ("sensors.landing_detection.min_range_m=0",),
            [
                "landing_detection.min_range_m is 0: a range finder that says 0 where it sees nothing, or is dead, "
                "would be on the ground, in the air too; give the least distance that it measures, e.g. 0.02"
            ],
        ),
        (
            "0.5",
            "[/camera/image, /lrf/range]",
            ("sensors.landing_detection.min_range_m=0", "sensors.landing_detection.source=pose"),
            [],
        ),
        (
            "0.5",
            "[/camera/image, /lrf/rnge, /somebody/elses]",
            (),
            ["groups.all of recording.yaml records /lrf/rnge, which nobody has: did you mean /lrf/range?"],
        ),
        (
            "0.5",
            "[/camera/image, /lrf/range]",
            ("autonomy.checks.check_reply_limit_s=12", "autonomy.checks.check_max_age_s=30"),
            [
                "takeoff.load_limit_s (10) is not above checks.check_reply_limit_s (12): the checks are asked again "
                "while the mission is loaded, and one that takes its time ends the takeoff"
            ],
        ),
        (
            "0.5",
            "[/camera/image, /lrf/range]",
            ("autonomy.checks.reply_limits_s.state_estimation=12", "autonomy.checks.check_max_age_s=30"),
            [
                "takeoff.load_limit_s (10) is not above checks.reply_limits_s.state_estimation (12): the checks are "
                "asked again while the mission is loaded, and one that takes its time ends the takeoff"
            ],
        ),
    ],
)
def test_what_files_do_not_mean_together_is_said(small, limit, group, overrides, expected):
    (small / "sensors.yaml").write_text((small / "sensors.yaml").read_text() + LRF.replace("LIMIT", limit))
    recording = (small / "recording.yaml").read_text().replace("[/camera/image]", group)
    (small / "recording.yaml").write_text(recording)
    assert contradictions(load_configuration(small, overrides).effective) == expected


@pytest.mark.parametrize("home_tolerance_m, says", [(2.4, True), (2.5, False)])
def test_a_second_takeoff_that_may_be_refused_for_a_good_landing_is_said(home_tolerance_m, says):
    overrides = [f"missions.planner.home_tolerance_m={home_tolerance_m}"]
    lines = contradictions(load_configuration(config_folder(), overrides).effective)
    found = [line for line in lines if "home_tolerance_m is 2.4, and mission 2 takes off more than once" in line]
    assert bool(found) is says
    assert bool(lines) is says, "what ships means what it says"


@pytest.mark.parametrize(
    "overrides, says",
    [
        (("missions.missions.1.controller=mission",), False),
        (("missions.missions.1.controller=offboard",), True),
        (("missions.missions.1.controller=offboard", "autopilot.parameters.COM_OBL_RC_ACT=4"), False),
        (("missions.missions.1.controller=offboard", "autopilot.offboard_parameters.COM_OBL_RC_ACT=4"), False),
        (("missions.missions.1.controller=offboard", "autopilot.offboard_parameters.COM_OF_LOSS_T=1.0"), True),
    ],
)
def test_set_points_whose_loss_nobody_looks_at_are_said(small, overrides, says):
    found = contradictions(load_configuration(small, overrides).effective)
    assert [line for line in found if "set-points" in line] == says * [
        "missions.yaml: mission 1 is flown by set-points, and COM_OBL_RC_ACT is compared in neither "
        "offboard_parameters nor parameters of autopilot.yaml: a PX4 does what it happens to be set to when they stop, "
        "in flight; add `offboard_parameters: {COM_OBL_RC_ACT: 4}` (4 is to land)"
    ]


SHARED = """\
  realsense_camera:
    group: other
    severity: CAMERA
    node: /realsense
    topics:
      /realsense/image: {rate_hz: 10.0}
    restart: {policy: node}
  realsense_imu:
    group: other
    severity: IMU
    node: NODE
    topics:
      /realsense/imu: {rate_hz: 100.0}
"""


@pytest.mark.parametrize(
    "camera, imu, node, overrides, says",
    [
        ("moderate", "highest", "/realsense", (), True),
        ("moderate", "high", "/realsense", (), True),
        ("high", "highest", "/realsense", (), True),
        ("low", "moderate", "/realsense", (), False),  # it is waited for, and flown on without
        ("highest", "highest", "/realsense", (), False),
        ("highest", "high", "/realsense", (), False),
        ("moderate", "highest", "/imu", (), False),
        ("moderate", "low", "/realsense", ("missions.missions.1.severities.realsense_imu=highest",), True),
        ("moderate", "highest", "/realsense", ("missions.missions.1.severities.realsense_imu=low",), False),
    ],
)
def test_a_restart_that_ends_the_node_of_what_is_landed_for_is_said(small, camera, imu, node, overrides, says):
    text = SHARED.replace("NODE", node)
    for name, severity in (("CAMERA", camera), ("IMU", imu)):
        wait = "\n    wait_limit_s: 20.0" if severity in ("moderate", "high") else ""
        text = text.replace(f"severity: {name}", f"severity: {severity}{wait}")
    (small / "sensors.yaml").write_text((small / "sensors.yaml").read_text() + text)
    found = contradictions(load_configuration(small, overrides).effective)
    assert [line for line in found if "restarted" in line] == says * [
        "components.realsense_camera of sensors.yaml is restarted by its node /realsense, which is that of "
        "realsense_imu, too: in flight that makes realsense_imu fail, for which mission 1 lands; give realsense_camera "
        "another policy, or realsense_imu no worse a severity"
    ]


MAVROS = """\
  imu:
    group: px4
    severity: highest
    topics:
      /mavros/imu/data_raw: {rate_hz: 50.0}
"""


@pytest.mark.parametrize(
    "overrides, expected",
    [
        ((), []),
        (("autopilot.backend=mavros",), []),
        (("autopilot.mavros=/uav1/mavros",), []),  # it is not used
        (
            ("autopilot.backend=mavros", "autopilot.mavros=/uav1/mavros"),
            [
                "autopilot.yaml says that mavros is at /uav1/mavros, and sensors.yaml and recording.yaml have "
                "/mavros/imu/data_raw, /mavros/state: is it that of another vehicle, or is one of the two names wrong?"
            ],
        ),
        (
            (
                "autopilot.backend=mavros",
                "autopilot.mavros=/uav1/mavros",
                "sensors.landing_detection.topic=/camera/image",
                "sensors.state_estimation.topic=/uav1/mavros/local_position/odom",
                "sensors.state_estimation.imu_topic=/uav2/mavros/imu/data",
            ),
            [
                "autopilot.yaml says that mavros is at /uav1/mavros, and sensors.yaml and recording.yaml have "
                "/mavros/imu/data_raw, /mavros/state, /uav2/mavros/imu/data: is it that of another vehicle, or is one "
                "of the two names wrong?"
            ],
        ),
    ],
)
def test_mavros_at_another_name_than_its_topics_is_said(small, overrides, expected):
    (small / "sensors.yaml").write_text((small / "sensors.yaml").read_text() + MAVROS)
    recording = (small / "recording.yaml").read_text().replace("[/camera/image]", "[/camera/image, /mavros/state]")
    (small / "recording.yaml").write_text(recording)
    found = contradictions(load_configuration(small, overrides).effective)
    assert [line for line in found if "mavros" in line] == expected


@pytest.mark.parametrize(
    "group, expected",
    [
        ("[/camera/image, /lrf/range, /odometry, /px4/imu]", []),
        ("[/camera/image, watchdog/action, /uav1/watchdog/action, ~journal, /tf]", []),
        ("[/camera/image, /odometri]", []),  # that is said already, with what was meant
        (
            "[/camera/image, wachdog/action, /somebody/elses]",
            [
                "groups.all of recording.yaml records wachdog/action, /somebody/elses, which no sensor, no node of "
                "ours and no map names: is each spelled as its node has it?"
            ],
        ),
        (
            "[/t1, /t2, /t3, /t4, /t5, /t6, /t7, /t8, /t9]",
            [
                "groups.all of recording.yaml records /t1, /t2, /t3, /t4, /t5, /t6, /t7 and 2 more, which no sensor, "
                "no node of ours and no map names: is each spelled as its node has it?"
            ],
        ),
    ],
)
def test_what_is_recorded_and_nothing_names_is_said(small, group, expected):
    recording = (small / "recording.yaml").read_text().replace("[/camera/image]", group)
    (small / "recording.yaml").write_text(recording)
    named = ("watchdog/action", "~journal", "/tf")
    assert unnamed_topics(load_configuration(small).effective, named) == expected
