"""A folder of the CNS Flight Stack's configuration, written from what is known of its format."""

from __future__ import annotations

from pathlib import Path

FILES = {
    "missions.yaml": """\
missions:
  mission_1:
    description: Square
    instances: 1
    filepaths: [square/square.csv]
    entities_actions:
      - [px4_gps, continue]
      - [px4_imu, failure]
      - [mission_cam, hold]
      - [lrf, land]
      - [optitrack, land]
  mission_2:
    description: Twice ahead and back
    instances: 2
    filepaths: [ahead.csv, square/square.csv]
    sequence_multiple_in_flight: true
    hover_after_mission_completion: true
    entities_actions:
      - [mission_cam, land]
      - [lrf, hold]
""",
    "watchdog/topics.yaml": """\
/mission_cam/image_raw: {entity_id: mission_cam, rate: 10, margin: 0.3, node_name: /mission_cam, window_size: 20}
/lrf/range: {entity_id: lrf, rate: 20.0, margin: 0.6, node_name: lrf, window_size: 2}
/mavros/imu/data_raw: {entity_id: px4_imu, rate: 100, margin: 0.1, node_name: /mavros, window_size: 100}
/uwb/ranges: {entity_id: UWB-Tag 1, rate: 5, margin: 0, node_name: /uwb, window_size: 10, severity: 2}
""",
    "watchdog/nodes.yaml": """\
/mission_cam: {entity_id: mission_cam, max_restart_attempts: 3, restart_timeout: 6}
/lrf: {entity_id: lrf, max_restart_attempts: 0, restart_timeout: 1}
/mavros: {entity_id: px4_imu, max_restart_attempts: 2, restart_timeout: 5}
""",
    "watchdog/drivers.yaml": """\
lrf_driver: {entity_id: lrf, check_script: /opt/lrf_check.sh, restart_script: /opt/lrf_restart.sh}
""",
    "trajectories/square/square.csv": "x,y,z,yaw,holdtime\n0,0,1.5,0,1\n3,0,1.5,5,1\n3,2,1.5,90,1\n0,0,1.5,0,1\n",
    "trajectories/ahead.csv": "x,y,z,yaw,holdtime\n0,0,2,0,0\n4,0,2,0,2\n0,0,2,180,0\n",
    "sequencer.yaml": "threshold_position: 0.3\n",
}


def write_folder(folder: Path, **changed: str) -> Path:
    """Write it; `changed` are other texts by the stems of the files."""
    for name, text in FILES.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(changed.get(path.stem, text))
    return folder
