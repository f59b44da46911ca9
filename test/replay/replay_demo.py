"""A flight of the simulated world as a bag of our own messages: what the demo records, written by the tests."""

from __future__ import annotations

import math

import numpy as np
from replay_bags import START_NS, S, distance, header, imu, magnetic, make, write_bag
from replay_runs import CONFIG

from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.engine import events
from amaze_autonomy.interface import status_of
from amaze_autonomy.journal.journal import read
from amaze_autonomy.simulation.run import run
from amaze_autonomy.simulation.scenario import Scenario

NAN = math.nan
RESTARTS = {"NONE": 0, "TRYING": 1, "GIVEN_UP": 2}


def _nan(value):
    return NAN if value is None else float(value)


def _of_row(event, **by_hand):
    """Return the message of a status without lists; a field that is new in its row is in it without being told."""
    row = status_of(event).shape
    return make(f"amaze_autonomy/msg/{row.message}", **{**row.write(event, event.t_ns, make), **by_hand})


def _component(status, t_ns):
    until = NAN if status.until_ns is None else (status.until_ns - t_ns) / S
    return make(
        "amaze_autonomy/msg/ComponentState",
        name=status.name,
        code=int(status.code),
        restart=RESTARTS[status.restart.name],
        until=until,
        reason=status.reason,
    )


def _action(event, at):
    return "/watchdog/action", make(
        "amaze_autonomy/msg/WatchdogAction",
        header=header(at),
        sequence=event.sequence,
        loop_counter=event.loop_counter,
        code=int(event.code),
        latest_component=event.latest_component,
        components=[_component(each, event.t_ns) for each in event.components],
    )


def _info(event, at):
    return "/watchdog/info", make(
        "amaze_autonomy/msg/WatchdogInfo",
        header=header(at),
        sequence=event.sequence,
        changed=list(event.changed),
        components=[_component(each, event.t_ns) for each in event.components],
    )


def _planner(event, at):
    return "/mission_planner/status", _of_row(
        event,
        header=header(at),
        session_id=event.session_id,
        mission_id=event.mission_id,
        phase=event.phase.value,
        waypoint=event.waypoint,
        waypoints=event.waypoints,
        file_index=event.file_index,
        repetition=event.repetition,
        distance_left=_nan(event.distance_left_m),
        time_left=_nan(event.time_left_s),
        message=event.message,
    )


def _autopilot(event, at):
    return "/autopilot/status", _of_row(
        event,
        header=header(at),
        link_age=_nan(event.link_age_s),
        armed_known=event.armed is not None,
        armed=bool(event.armed),
        landed=event.landed.value,
        mode=event.mode,
        pilot_in_control=event.pilot_in_control,
        failsafe=event.failsafe,
        height_valid=event.height_m is not None,
        height=_nan(event.height_m),
        position_valid=event.position_x_m is not None,
        position_x=_nan(event.position_x_m),
        position_y=_nan(event.position_y_m),
        vertical_speed=_nan(event.vertical_speed_m_s),
        horizontal_speed=_nan(event.horizontal_speed_m_s),
        battery_fraction=_nan(event.battery_fraction),
        battery_voltage=_nan(event.battery_voltage_v),
        battery_age=_nan(event.battery_age_s),
        battery_critical=event.battery_critical,
        gps=1,
        imu=1,
        magnetometer=1,
        barometer=1,
        rc=1,
        prearm=1,
        tilt=NAN if event.tilt_deg is None else math.radians(event.tilt_deg),
        battery_cell_voltage=NAN,
        battery_current=NAN,
        clock_offset=NAN,
        gps_fix=event.gps_fix,
        satellites=_nan(event.satellites),
        sensors_sequence=1 + at * 2 // S,  # SYS_STATUS comes twice a second
        gps_sequence=0,
    )


def _landed(event, at):
    return "/landing_detection/landed", _of_row(
        event,
        header=header(at),
        landed=event.landed.value,
        distance=_nan(event.distance_m),
        reason=event.reason,
    )


def _recorder(event, at):
    return "/data_recorder/status", make(
        "amaze_autonomy/msg/RecordingStatus",
        header=header(at),
        session_id=event.session_id,
        phase=event.phase.value,
        progress=_nan(event.progress),
        platforms=[
            make(
                "amaze_autonomy/msg/PlatformRecording",
                platform=each.platform,
                growing=each.growing,
                bytes=each.written_bytes,
                byte_rate=_nan(each.byte_rate),
                free_fraction=_nan(each.free_fraction),
                location=each.location,
                message=each.message,
                dropped=0,
                cpu_fraction=_nan(each.cpu_fraction),
                clock_age=_nan(each.clock_age_s),
            )
            for each in event.platforms
        ],
        location=event.location,
        message=event.message,
        lost=event.lost,
        remaining=NAN,
        dropped=0,
    )


MESSAGES = {
    events.WatchdogAction: _action,
    events.WatchdogInfo: _info,
    events.MissionStatus: _planner,
    events.AutopilotStatus: _autopilot,
    events.LandedStatus: _landed,
    events.RecordingStatus: _recorder,
}


def simulated(scenario=None, mission="1"):
    """Fly a mission, or several as in "2,1", in the simulated world; return the journal's lines."""
    configuration = load_configuration(CONFIG)
    known = {each.id: each for each in configuration.missions}
    missions = tuple(known[each] for each in mission.split(","))
    return run(configuration, missions, scenario or Scenario()).lines


def demo_bag(
    path,
    lines,
    *,
    with_journal=True,
    planner_phase=None,
    without=(),
    action_until_s=math.inf,
    flight=0,
    written=write_bag,
):
    """Write the bag that a recorder would have made of a journal's flight: from START_RECORDING on, with sensors.

    Args:
        path: of the bag.
        lines: of the journal.
        with_journal: the bag carries it as well.
        planner_phase: that every status of the planner holds; None: its own.
        without: topics that are left out.
        action_until_s: from then on, from the start of the bag, no heartbeat is recorded.
        flight: number of the mission among those of the journal.
        written: writes the messages to the path.
    """
    payloads = [line.payload for line in read("\n".join(lines) + "\n").lines]
    decisions = [p for p in payloads if type(p).__name__ == "Decision" and p.before != p.after]
    began, ended = (
        [p.t_ns for p in decisions if p.after == after][flight] for after in ("START_RECORDING", "DATA_CLEANUP")
    )
    begins_ns = began + S // 2  # the recorder needs a moment
    shift = START_NS - begins_ns
    rows = []
    for index, (line, payload) in enumerate(zip(lines, payloads)):
        t_ns = getattr(payload, "t_ns", 0)
        if t_ns > ended + S // 10:
            break
        at = max(t_ns, begins_ns) + shift + 2_000_000
        if with_journal:
            rows.append((at, "/autonomy/journal", _entry(index, line, at)))
        if type(payload) in MESSAGES and t_ns >= begins_ns:
            topic, message = MESSAGES[type(payload)](payload, t_ns + shift)
            if planner_phase is not None and topic == "/mission_planner/status":
                message.phase = planner_phase
            if topic != "/watchdog/action" or t_ns - begins_ns < action_until_s * S:
                rows.append((t_ns + shift, topic, message))
    heights = [(p.t_ns, p.height_m or 0.0) for p in payloads if type(p).__name__ == "AutopilotStatus"]
    for step in range(int((ended - begins_ns) / S * 100)):
        at = START_NS + step * S // 100
        rows.append((at, "/px4/imu", imu(at)))
        height_m = next((h for t, h in reversed(heights) if t <= at - shift), 0.0) if step % 5 == 0 else 0.0
        rows += [(at, "/lrf/range", distance(at, 0.1 + height_m))] if step % 5 == 0 else []
        rows += [(at, "/odometry", odometry(at))] if step % 3 == 0 else []
        rows += [(at, "/px4/gps", magnetic(at))] if step % 20 == 0 else []  # that it comes is all that counts
    return written(path, sorted((row for row in rows if row[1] not in without), key=lambda row: row[0]))


def _entry(index, line, at):
    kind = line.split('"kind":"')[1].split('"')[0]
    return make("amaze_autonomy/msg/JournalEntry", header=header(at), sequence=index, kind=kind, line=line)


def odometry(t_ns):
    zero = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    covariance = np.diag([1e-4] * 6).ravel()
    pose = make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0),
        orientation=make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
    )
    return make(
        "nav_msgs/msg/Odometry",
        header=header(t_ns),
        child_frame_id="",
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
        twist=make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=make("geometry_msgs/msg/Twist", linear=zero, angular=zero),
            covariance=covariance,
        ),
    )
