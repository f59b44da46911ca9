"""The nominal mission by MAVSDK, on the same autopilots and the same wire: what does a hold, a resume, a landing take?

    ./run sitl-mavsdk [px4|ardupilot] [-n TIMES] [--output FOLDER]

MAVSDK (from PyPI) uploads the square of mission 1, arms, flies, is paused, goes on, and lands on its way. Measured is
the time from each call to the mode that the vehicle shows, on the link of the second ground station; `./run sitl` takes
it from the engine's decision, or from the code 16 that it decides on. FOLDER/mavsdk.json has all figures, for
sitl_table.py. Root only, as ./run sitl.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from sitl_autopilots import GROUND, KINDS, NODE, PLANNER, ROOT, Autopilot, folder_of, ready_to_run  # noqa: E402
from sitl_relay import Relay  # noqa: E402
from sitl_station import Station  # noqa: E402
from sitl_wire import read_wire  # noqa: E402

from amaze_autonomy.engine.events import VehicleLanded  # noqa: E402

_PORT, _UP_M, _SIDE_M, _METRES_PER_DEGREE = 14540, 1.5, 4.0, 111_320.0
_READY_S, _LIMIT_S, _FLYING_S, _HELD_S = 120.0, 120.0, 6.0, 4.0
_MODES = {"start": "AUTO.MISSION", "hold": "AUTO.LOITER", "resume": "AUTO.MISSION", "land": "AUTO.LAND"}
NOT_RUN = 77
FIGURES = "mavsdk.json"


def main() -> int:
    """Fly; print a table; return 0, 1 when a flight failed, 77 when there is nothing to fly with."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("autopilots", nargs="*", metavar="px4|ardupilot", help="on which (default: both)")
    parser.add_argument("-n", "--times", type=int, default=3, help="how often (default: 3)")
    parser.add_argument("--output", type=Path, help="where to write mavsdk.json (default: nowhere)")
    parser.add_argument("--inside", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside:
        print(json.dumps(_fly(options.autopilots[0], Path(options.inside))))
        return 0
    chosen = [name for name in options.autopilots or KINDS if folder_of(name) is not None]
    if not chosen or os.geteuid() != 0:
        print("NO AUTOPILOT IN SOFTWARE-IN-THE-LOOP HERE, OR NOT ROOT: NOTHING IS FLOWN")
        return NOT_RUN
    print(f"{'MAVSDK':<12}" + "".join(f"{name + ' to mode':>18}" for name in _MODES))
    took = [(name, _attempt(name, number)) for name in chosen for number in range(options.times)]
    if options.output:
        options.output.mkdir(parents=True, exist_ok=True)
        rows = [{"autopilot": name, "to_mode_s": times} for name, times in took]
        (options.output / FIGURES).write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0 if all(times for _, times in took) else 1


def _attempt(name: str, number: int) -> Dict[str, float]:
    """Fly once; return what each call took, nothing when it failed."""
    folder = Path(tempfile.mkdtemp(prefix=f"amaze_mavsdk_{name}_{number}_"))
    command = ["unshare", "--net", sys.executable, __file__, name, "--inside", str(folder)]
    with (folder / "flight.txt").open("wb") as log:
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=log, check=False, timeout=600.0)
    if done.returncode:
        print(f"{name:<12} failed: see {folder}")
        return {}
    took: Dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    print(f"{name:<12}" + "".join(f"{took[each]:>16.3f} s" for each in _MODES), flush=True)
    return took


def _fly(name: str, folder: Path) -> Dict[str, float]:
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True, timeout=60)
    kind, program = KINDS[name], folder_of(name)
    if program is None:
        raise SystemExit(f"no {name} here")
    links = {"node": (NODE, _PORT), "planner": (PLANNER, 14541), "ground": (GROUND, 14550)}
    relay = Relay(links, folder)
    autopilot = Autopilot(kind, ready_to_run(name, program, ROOT / "build"), folder / "vehicle", {})
    station = Station(relay.links["ground"], kind)
    relay.start()
    station.start()
    autopilot.start()
    try:
        _wait(lambda: station.ready and station.real_time(), "the autopilot is ready", _READY_S)
        called = _mission(station, takes_off=name == "ardupilot")
    finally:
        station.stop()
        autopilot.kill()
        relay.stop()
    wire = read_wire(folder, name)
    return {what: (wire.first_shown(_MODES[what], at_s) or float("nan")) - at_s for what, at_s in called.items()}


def _mission(station: Station, *, takes_off: bool) -> Dict[str, float]:
    """Fly by MAVSDK; return when each call was made, in s since 1970."""
    from mavsdk import ComponentType, Configuration, Mavsdk  # noqa: PLC0415
    from mavsdk.plugins.action import Action  # noqa: PLC0415
    from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan  # noqa: PLC0415

    called: Dict[str, float] = {}

    def call(what: str, order: Callable[[], Any]) -> None:
        called[what] = time.time()
        order()
        _wait(lambda: station.seen.mode == _MODES[what], f"{what} is shown", 20.0)

    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as sdk:
        sdk.add_any_connection(f"udpin://127.0.0.1:{_PORT}")
        system = sdk.first_autopilot(20.0)
        if system is None:
            raise SystemExit("MAVSDK does not hear the autopilot")
        action, mission = Action(system), Mission(system)
        home = station.heard["HOME_POSITION"]
        latitude, longitude = home.latitude * 1e-7, home.longitude * 1e-7
        step = _SIDE_M / _METRES_PER_DEGREE
        corners = [(0.0, 0.0), (0.0, step), (step, step), (step, 0.0), (0.0, 0.0)]
        items = [_item(MissionItem, latitude + north, longitude + east) for north, east in corners]
        mission.upload_mission(MissionPlan(items))
        action.arm()
        if takes_off:  # MAVSDK's missions have no takeoff for ArduPilot
            action.set_takeoff_altitude(_UP_M)
            action.takeoff()
            _wait(lambda: station.seen.landed is VehicleLanded.IN_AIR, "it is in the air", 20.0)
        call("start", mission.start_mission)
        threading.Event().wait(_FLYING_S)
        call("hold", mission.pause_mission)
        threading.Event().wait(_HELD_S)
        call("resume", mission.start_mission)
        threading.Event().wait(_FLYING_S)
        call("land", action.land)
        _wait(lambda: not station.seen.armed, "it has landed", _LIMIT_S)
    return called


def _item(kind: Any, latitude_deg: float, longitude_deg: float) -> Any:
    return kind(
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        relative_altitude_m=_UP_M,
        speed_m_s=1.0,
        is_fly_through=False,
    )


def _wait(condition: Callable[[], bool], what: str, limit_s: float) -> None:
    deadline = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > deadline:
            raise SystemExit(f"it never came that {what}")
        time.sleep(0.02)


if __name__ == "__main__":
    sys.exit(main())
