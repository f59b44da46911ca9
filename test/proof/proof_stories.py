"""What no single lie, stall or signal may do, and who tells it: in virtual time, live, in flights with real autopilots.

A story is `file::function` below test/. Live ones have a real master: those of `ros/lies.py` and `ros/launches.py` are
the whole launch file with all real nodes, and a PX4 over MAVLink. Flights are scenarios of `./run sitl`.
"""

from __future__ import annotations

from pathlib import Path
from typing import List, NamedTuple, Sequence, Tuple

_TEST = Path(__file__).resolve().parents[1]
_LIES = "engine/test_lies.py::test_"
_SOURCES = "autopilot/test_sources.py::test_"
_STOOD = "autopilot/test_standing_still.py::test_"
_STANDS = "autopilot/test_landing_stands.py::test_"
_MAVROS = "autopilot/test_mavros_messages.py::test_"
_AGES = "autopilot/test_modes_and_ages.py::test_"
_LIVE = "ros/lies.py::"
_LAUNCH = "ros/launches.py::"


class Told(NamedTuple):
    """One sentence.

    Args:
        words: what holds.
        pure: stories in virtual time.
        live: with a real master.
        flown: scenarios with real autopilots.
    """

    words: str
    pure: Tuple[str, ...]
    live: Tuple[str, ...] = ()
    flown: Tuple[str, ...] = ()


STORIES: Sequence[Told] = (
    Told(
        "One wrong status ends no flight, and what fails afterwards is landed for.",
        (
            f"{_LIES}code_16_lands_after_any_one_wrong_status",
            f"{_LIES}two_wrong_statuses_in_half_a_second_end_no_flight",
        ),
        (f"{_LIVE}one_forged_status_in_flight_ends_no_supervision",),
    ),
    Told(
        "A takeover stops commanding at once, and is believed when it lasts; what failed meanwhile is answered.",
        (
            f"{_LIES}a_takeover_stops_commanding_at_once_and_is_believed_when_it_lasts",
            f"{_LIES}what_failed_during_a_lie_is_answered_when_the_truth_is_back",
        ),
        (f"{_LIVE}pilot_keeps_a_vehicle_whose_imu_fails_and_an_unattended_run_ends",),
        ("takeover_by_sticks", "takeover_by_return"),
    ),
    Told(
        "A landing that the operator asks for in that moment is not forgotten: it goes out when the vehicle is ours.",
        (f"{_LIES}a_landing_that_the_user_asks_for_in_that_moment_is_not_forgotten",),
    ),
    Told(
        "A vehicle in the air is landed when the planner says that nothing is flown, or nothing is known of it.",
        (
            "engine/test_losses.py::test_lost_in_flight",
            "engine/test_landing.py::test_a_landing_of_which_nothing_is_known_any_more_may_be_given_up",
        ),
    ),
    Told(
        "A vehicle that falls silent in the pilot's hands may be given up: there is a way out of every state.",
        ("engine/test_pilot.py::test_a_vehicle_that_fell_silent_in_the_pilots_hands_may_be_given_up",),
    ),
    Told(
        "Two wrong statuses far apart disarm nothing, and one does not tell whether it was armed at the start.",
        (
            "engine/test_landing.py::test_two_wrong_statuses_far_apart_disarm_nothing",
            "engine/test_ending.py::test_one_wrong_status_does_not_tell_whether_it_was_armed_at_the_start",
        ),
    ),
    Told(
        "Armed and in the air again after an end that was believed is our flight, wherever its end was believed.",
        (
            f"{_LIES}armed_and_airborne_again_after_a_believed_end_is_still_our_flight",
            f"{_LIES}a_vehicle_that_is_in_the_air_between_two_files_is_landed",
            f"{_LIES}a_flight_that_was_never_ours_and_seemed_over_is_landed_again",
            f"{_LIES}who_arms_it_on_the_ground_after_the_mission_may_fly_it",
        ),
    ),
    Told(
        "Nothing holds a landing: no failure, no operator, whoever lands.",
        (f"{_LIES}what_fails_during_the_planners_own_landing_holds_nothing", f"{_LIES}nor_does_the_operator"),
        (
            f"{_LIVE}nothing_holds_the_planners_own_landing",
            "ros/resume.py::killed_in_the_planners_own_landing",
        ),
        ("code_16_in_landing",),
    ),
    Told(
        "Whatever one message of the vehicle says, both nodes go on with its flight, and a landing stands.",
        tuple(
            f"autopilot/test_vehicle_lies.py::test_{name}"
            for name in (
                "whatever_one_message_says_at_any_moment_of_a_flight",
                "whatever_one_message_says_at_any_moment_of_a_landing_by_the_autopilot_node",
                "a_takeover_that_one_heartbeat_says_is_over_before_the_engine_believes_it",
            )
        ),
        (
            "ros/mission_planner.py::test_datagrams_that_say_down_end_no_flight_and_no_landing",
            "ros/autopilot.py::test_a_landing_stands_whatever_one_datagram_says",
        ),
    ),
    Told(
        "At a critical battery a pilot keeps his ArduCopter.",
        ("autopilot/test_planner_ardupilot.py::test_at_a_critical_battery_a_pilot_in_loiter_keeps_it",),
        flown=("battery_low_ignored",),
    ),
    Told(
        "A landing that none of ours commanded is somebody else's.",
        (f"{_LIES}a_landing_that_nobody_of_us_commanded_is_somebody_elses",),
        (f"{_LIVE}link_that_loses_a_fifth_ends_no_flight_and_somebody_elses_landing_is_left_alone",),
        ("takeover_by_landing",),
    ),
    Told(
        "A landing that a node of ours begins because it is told to end is ours: nobody is told to fly.",
        (
            f"{_LIES}a_landing_that_the_planner_says_before_it_is_believed_to_be_another_s_is_ours",
            f"{_LIES}a_planner_that_lands_and_ends_is_landed_for",
        ),
        (
            f"{_LAUNCH}planner_that_the_master_ends_in_flight_lands_and_is_not_taken_for_a_pilot",
            f"{_LAUNCH}autopilot_node_that_is_told_to_end_in_flight_lands_and_is_not_taken_for_a_pilot",
        ),
    ),
    Told(
        "A node that dies in flight takes no other with it; one that the flight depends on is landed for.",
        ("engine/test_losses.py::test_lost_in_flight",),
        tuple(
            f"{_LAUNCH}{name}"
            for name in (
                "checks_that_are_killed_in_flight_come_back_alone_and_the_mission_goes_on",
                "watchdog_that_is_killed_in_flight_ends_the_mission_with_a_landing",
                "planner_that_is_killed_in_flight_ends_the_mission_with_a_landing",
                "autopilot_node_that_is_killed_in_flight_ends_the_mission_with_a_landing",
                "node_group_that_is_killed_in_flight_costs_the_mission_not_the_landing",
            )
        ),
    ),
    Told(
        "Connections that say nothing keep no command out.",
        (),
        ("ros/stalls.py::connections_that_say_nothing_keep_no_command_out",),
    ),
    Told(
        "A takeoff is not carried out after its user was told that there is no answer, or has gone; a landing is.",
        (
            "nodes/test_asker.py::test_what_the_console_shows_as_not_answered_is_not_decided_about_when_the_engine_goes_on",
            "nodes/test_asker.py::test_what_the_console_shows_as_not_answered_does_not_arrive_when_the_network_returns",
            "nodes/test_asker.py::test_a_takeoff_whose_user_has_gone_meanwhile_is_not_decided_about",
        ),
        ("ros/stalls.py::takeoff_that_nobody_waits_for_any_more_is_not_carried_out_when_the_engine_goes_on",),
    ),
    Told(
        "A terminal or a disk that is held (Ctrl-S, a connection or a card that hangs) holds up no node.",
        (
            "nodes/test_process.py::test_a_terminal_and_a_disk_that_are_held_hold_up_nobody_and_a_node_ends_all_the_same",
            "nodes/test_outbox.py::test_a_disk_that_holds_up_a_write_for_ever_silences_neither_state_nor_messages",
        ),
        (f"{_LAUNCH}terminal_whose_output_is_held_in_flight_holds_up_nothing_else",),
    ),
    Told(
        "Holding is shown by flight mode or standing still; else it is asked again, and landed at the limit.",
        (
            f"{_LIES}the_planners_word_alone_shows_no_hold",
            f"{_LIES}a_vehicle_that_flies_on_or_climbs_away_while_it_should_hold_is_told_again_and_landed",
        ),
        (f"{_LIVE}planner_that_says_holding_while_the_vehicle_flies_on_is_not_believed",),
        ("hold_and_resume",),
    ),
    Told(
        "An engine that was stopped reads what waited before it judges; a code 16 among it lands at once.",
        (
            "nodes/test_inbox.py::test_what_lay_in_the_sockets_while_it_was_stopped_is_stamped_with_when_it_came",
            "nodes/test_inbox.py::test_a_stop_at_any_reading_of_its_clocks_makes_nothing_later_than_it_came",
            "nodes/test_engine_thread.py::test_a_stop_between_reading_and_tick_makes_no_tick_of_what_had_come_meanwhile",
        ),
        (
            "ros/stalls.py::engine_that_is_stopped_for_longer_than_the_limit_of_a_heartbeat_flies_on",
            f"{_LIVE}code_16_while_the_engine_is_stopped_lands_when_it_goes_on",
        ),
    ),
    Told(
        "A planner or autopilot node that was stopped listens before it commands, a landing no longer than it must.",
        (
            f"{_STOOD}what_was_under_way_is_not_sent_over_a_pilot_who_took_over_meanwhile",
            f"{_STOOD}a_landing_is_not_sent_over_a_pilot_whose_takeover_lies_unread_or_found_the_socket_full",
            f"{_STOOD}the_autopilot_node_does_not_land_over_a_pilot_whose_takeover_lies_unread_or_is_lost",
        ),
        (
            f"{_LIVE}planner_that_stood_still_resumes_nothing_over_the_pilot",
            f"{_LIVE}planner_and_autopilot_node_that_stood_still_land_nothing_over_the_pilot",
        ),
    ),
    Told(
        "In flight nobody needs the ROS master: one that hangs stops no thread, and no command.",
        (
            "nodes/test_rospy_flaws.py::test_who_logs_asks_the_master_once",
            "nodes/test_mavros_link.py::test_what_is_commanded_has_a_connection_that_stays_open",
        ),
        ("ros/master.py::flight_goes_on_and_a_code_16_lands_while_the_master_is_stopped",),
    ),
    Told(
        "Behind mavros a landing waits for nothing that mavros waits for, and what waited is not commanded late.",
        (
            "nodes/test_mavros_link.py::test_a_landing_waits_for_no_command_that_hangs",
            "nodes/test_mavros_link.py::test_what_waited_behind_a_service_that_hung_is_not_sent_any_more_but_for_a_landing",
        ),
        ("ros/mavros.py::test_it_lands_through_set_mode_and_disarms_by_command",),
    ),
    Told(
        "A serial device or a network that stalled brings no command late, no landing either: it is said again.",
        (
            "autopilot/test_stalled_output.py::test_no_landing_that_is_old_comes_out_of_a_serial_device_that_stalled_and_it_stays_open",
            "autopilot/test_stalled_output.py::test_no_landing_that_is_old_comes_over_tcp_after_the_network_was_away",
            "autopilot/test_stalled_output.py::test_over_a_connection_that_nobody_has_spoken_on_nothing_is_commanded",
        ),
    ),
    Told(
        "An engine with a thread that ends or hangs lands and goes on anew; one that hangs altogether ends the stack.",
        (
            "nodes/test_ending.py::test_threads_go_on_that_live_and_of_which_the_one_that_decides_has_turned_within_five_seconds",
            "nodes/test_engine_thread.py::test_who_replaces_it_while_it_hangs_decides_alone_also_when_it_goes_on",
        ),
        (
            "ros/ends.py::engine_whose_thread_ends_in_flight_lands_by_both_routes_and_goes_on_as_another",
            "ros/ends.py::engine_whose_thread_hangs_in_flight_lands_by_both_routes_and_goes_on_as_another",
            "ros/ends.py::engine_whose_journal_nobody_writes_any_more_lands_by_both_routes_and_goes_on_as_another",
            "ros/ends.py::engine_that_hangs_in_all_its_threads_ends_and_says_where",
            f"{_LAUNCH}planner_and_autopilot_node_land_when_the_engine_is_killed_in_flight_and_the_launch_ends",
        ),
    ),
    Told(
        "SIGHUP in flight lands, to the engine, the nodes, the whole launch, and by a terminal that is closed.",
        ("engine/test_ending.py::test_told_to_end",),
        (
            "ros/ends.py::sighup_in_flight_lands_by_both_routes",
            f"{_LAUNCH}sighup_to_the_engine_in_flight_lands",
            f"{_LAUNCH}terminal_that_is_closed_in_flight_lands",
            "ros/mission_planner.py::test_told_to_end_in_flight_it_lands",
            "ros/mavros.py::test_told_to_end_in_flight_it_lands",
        ),
    ),
    Told(
        "The nodes that decide take precedence, of their session, too; what is not permitted is logged once.",
        ("nodes/test_process.py::test_a_node_with_a_session_of_its_own_takes_precedence_for_the_session_too",),
        (f"{_LAUNCH}nodes_that_decide_take_the_precedence_that_is_permitted",),
    ),
    Told(
        "A heartbeat grows, for each publisher.",
        (f"{_LIES}two_publishers_whose_counters_stand_are_no_heartbeat",),
        (f"{_LIVE}two_heartbeats_whose_counters_stand_are_none",),
    ),
    Told(
        "A /clock that stands is landed for, and warned of before takeoff.",
        (
            f"{_LIES}a_clock_that_stands_lands_on_both_routes",
            f"{_LIES}a_clock_that_stands_is_said_before_takeoff_and_forbids_it",
        ),
        (
            "ros/clock.py::real_nodes_land_a_vehicle_by_mavlink_while_the_clock_stands",
            "ros/clock.py::clock_that_stands_on_the_ground_is_warned_of",
        ),
    ),
    Told(
        "A second vehicle with our system id forbids takeoff, and is ignored in flight; our silence is noticed.",
        (
            f"{_SOURCES}a_stranger_refuses_the_takeoff_with_its_address",
            f"{_SOURCES}in_flight_our_silence_is_silence_though_the_other_speaks_on",
            f"{_SOURCES}two_vehicles_behind_one_router_are_never_mixed",
        ),
        (f"{_LIVE}second_vehicle_with_our_id_forbids_takeoff_and_is_ignored_in_flight",),
    ),
    Told(
        "Nobody is waited for in vain: an unattended run ends once its vehicle is heard to be down, and a person may "
        "end one whose autopilot node is dead.",
        (
            "nodes/test_unattended.py::test_a_pilots_landing_is_acknowledged_once_the_flight_is_over",
            f"{_LIES}after_the_alarm_a_person_may_end_a_mission_whose_vehicle_is_silent",
        ),
        (
            f"{_LIVE}pilot_keeps_a_vehicle_whose_imu_fails_and_an_unattended_run_ends",
            f"{_LIVE}operator_ends_a_mission_whose_autopilot_node_is_dead_for_good",
        ),
    ),
    Told(
        "A mission flown to its end is COMPLETE, with what failed.",
        (f"{_LIES}a_mission_flown_to_its_end_is_complete_whatever_fails_in_the_last_metres",),
        (f"{_LIVE}nothing_holds_the_planners_own_landing",),
        ("code_16_in_landing",),
    ),
    Told(
        "Clocks of two computers that differ are a row before takeoff, and named in flight.",
        (
            f"{_LIES}clocks_apart_forbid_a_takeoff_and_say_so",
            f"{_LIES}stamps_of_another_clock_are_named_as_clocks",
        ),
        (f"{_LAUNCH}clock_of_another_computer_that_is_a_second_ahead_is_named_before_takeoff",),
    ),
    Told(
        "What is not there yet, and what comes by itself, is waited for up to a limit.",
        (
            f"{_LIES}a_peer_that_is_not_there_yet_is_waited_for_while_the_stack_starts",
            f"{_LIES}a_peer_that_was_not_there_is_asked_again_however_long_the_other_checks_took",
            f"{_LIES}rows_that_come_by_themselves_are_waited_for",
            f"{_LIES}what_nobody_has_heard_yet_is_waited_for_while_the_stack_starts",
            "nodes/test_startup.py::test_what_is_unknown_comes_by_itself_for_the_configured_time",
        ),
        (f"{_LAUNCH}mission_selected_at_once_waits_for_its_nodes_and_for_the_vehicle",),
    ),
    Told(
        "Two batteries through mavros are two, and the worst counts.",
        ("autopilot/test_mavros_messages.py::test_two_batteries_on_one_topic_are_told_apart_and_the_worst_counts",),
        ("ros/mavros.py::test_of_two_batteries_on_one_topic_the_worst_counts_and_nothing_jumps",),
    ),
    Told(
        "The autopilot behind mavros is the one whose modes it names; it never changes in the air, and nobody's flies.",
        (
            f"{_MAVROS}in_the_air_the_autopilot_never_changes",
            f"{_MAVROS}a_mode_that_nobody_knows_keeps_the_autopilot_and_is_none_of_ours",
            f"{_MAVROS}nobody_takes_off_before_it_is_known_who_lands_it",
        ),
        (
            "ros/mavros.py::test_an_ardupilot_is_one_by_its_modes_and_its_pilot_by_loiter",
            "ros/mavros.py::test_an_ardupilot_is_landed_by_its_own_name_of_the_mode",
            "ros/mavros_planner.py::test_an_ardupilot_whose_pilot_switches_to_loiter_is_left_alone",
        ),
    ),
    Told(
        "LAND is always taken, replaces what runs and stands; after a silence nothing goes on, nothing arms.",
        (
            f"{_STANDS}a_landing_is_taken_while_the_vehicle_is_silent_and_nothing_else_is_sent_when_it_is_heard_again",
            f"{_STANDS}a_landing_takes_the_place_of_a_takeoff_before_its_arming_and_nothing_arms_afterwards",
            f"{_STANDS}when_the_autopilot_node_lands_the_planner_does_nothing_else",
        ),
        (
            f"{_LIVE}link_that_is_cut_at_the_arming_is_landed_for_and_nothing_goes_on_afterwards",
            "ros/mission_planner.py::test_a_landing_by_the_autopilot_node_stands_in_the_planner_as_well",
        ),
        ("cut_5_s_in_arming", "cut_20_s_in_arming", "cut_5_s_in_hold"),
    ),
    Told(
        "Only a fresh ON_GROUND disarms.",
        (
            f"{_STANDS}a_failed_takeoff_does_not_disarm_on_what_the_vehicle_said_a_while_ago",
            "autopilot/test_client.py::test_nothing_disarms_on_a_landed_state_that_is_old",
            "engine/test_landing.py::test_never_disarmed_while_airborne_or_unknown",
        ),
        (
            "ros/autopilot.py::test_it_lands_and_disarms_on_the_ground_only",
            f"{_LIVE}vehicle_whose_ground_is_no_longer_told_is_not_disarmed_in_the_air",
        ),
        ("cut_5_s_in_takeoff",),
    ),
    Told(
        "A failsafe has control when it has left our mode; a critical battery lands.",
        (
            f"{_AGES}a_failsafe_of_ardupilot_has_control_when_it_has_chosen_the_mode",
            "engine/test_losses.py::test_a_battery_that_the_autopilot_calls_critical_lands_whatever_its_level",
        ),
        (f"{_LIVE}ardupilot_at_a_critical_battery_that_it_leaves_alone_is_landed",),
        ("battery_low_ignored", "battery_critical"),
    ),
    Told(
        "Over MAVLink a takeover is known within a fifth of a second, and no landing takes the vehicle back.",
        (f"{_AGES}a_takeover_on_px4_is_known_within_a_fifth_of_a_second_whenever_it_comes",),
        ("ros/autopilot.py::test_a_pilot_is_seen_at_once_where_heartbeats_are_lost_and_is_not_fought",),
        ("takeover_then_code_16",),
    ),
    Told(
        "A link is as old as anything that came over it; what decides has an age of its own.",
        (
            f"{_AGES}a_fifth_of_all_packets_lost_for_two_minutes_makes_nothing_unknown",
            f"{_AGES}each_value_that_grows_old_is_unknown_while_the_link_is_young",
        ),
        (f"{_LIVE}link_that_loses_a_fifth_ends_no_flight_and_somebody_elses_landing_is_left_alone",),
        ("loss_5_percent", "loss_20_percent"),
    ),
    Told(
        "The operator reads why it does not arm, no word that is not so, and none of them for ever.",
        (
            f"{_AGES}why_px4_does_not_arm_is_known_without_a_ground_station_by_its_events",
            f"{_LIES}what_is_flown_on_without_does_not_say_so_while_it_lands",
        ),
        (
            f"{_LIVE}reason_why_arming_is_refused_reaches_the_operator",
            "ros/mission_planner.py::test_a_landing_is_taken_of_a_vehicle_that_is_silent_and_repetitions_are_not_logged",
        ),
        ("arming_denied", "arming_denied_at_takeoff"),
    ),
)


def missing() -> List[str]:
    """Return the stories that nobody tells."""
    named = {each for told in STORIES for each in (*told.pure, *told.live)}
    gone = [each for each in sorted(named) if f"def {each.split('::')[1]}(" not in _text(each.split("::")[0])]
    flown = {name for told in STORIES for name in told.flown}
    return gone + [name for name in sorted(flown) if not (_TEST / "sitl" / "scenarios" / f"{name}.yaml").is_file()]


def _text(name: str) -> str:
    path = _TEST / name
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def stories() -> List[Tuple[str, str, str, str]]:
    """Return a row for each sentence: words, and who tells it."""
    return [
        (told.words, _cell(told.pure), _cell(told.live), ", ".join(f"`{name}`" for name in told.flown) or "-")
        for told in STORIES
    ]


def _cell(names: Sequence[str]) -> str:
    files = dict.fromkeys(name.split("::")[0] for name in names)
    said = {file: [_words(name) for name in names if name.startswith(f"{file}::")] for file in files}
    return "; ".join(f"`{file}`: {', '.join(words)}" for file, words in said.items()) or "-"


def _words(name: str) -> str:
    return name.split("::")[1].replace("test_", "", 1).replace("_", " ")
