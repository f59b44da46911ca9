"""Messages and services of the CNS Flight Stack, written from their fields, and their md5 sums as ROS makes them.

`classes()` makes the classes by genpy, where that is there; `install(folder)` packages that a node can import;
`sources(folder)` packages that catkin builds.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any, Dict, List, Tuple

PACKAGES = ("watchdog_msgs", "mission_sequencer")
"""Those that Debian does not have."""
HEADER = "std_msgs/Header header\n"
REQUESTS = "UNDEF=0 ARM=1 TAKEOFF=2 HOLD=3 RESUME=4 LAND=5 HOVER=6 ABORT=7 DISARM=8 READ=101"


def _constants(text: str) -> str:
    return "".join(f"uint8 {each}\n" for each in text.split())


MESSAGES: Dict[str, str] = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id\n",
    "std_msgs/Bool": "bool data\n",
    "watchdog_msgs/Status": "string entity\nuint8 type\n"
    + _constants("GLOBAL=0 TOPIC=1 NODE=2 DRIVER=3")
    + "uint8 status\n"
    + _constants("UNDEF=0 NOMINAL=1 STARTING=2 DEFECT=4 ERROR=8")
    + "string name\nstring info\n",
    "watchdog_msgs/StatusStamped": HEADER + "watchdog_msgs/Status status\n",
    "watchdog_msgs/StatusChangesArray": "watchdog_msgs/Status[] changes\nwatchdog_msgs/Status[] current\n",
    "watchdog_msgs/StatusChangesArrayStamped": HEADER + "watchdog_msgs/StatusChangesArray data\n",
    "watchdog_msgs/Action": "watchdog_msgs/Status entity\nuint8 action\n"
    + _constants("NOTHING=0 FIX_NODE=1 FIX_DRIVER=2"),
    "watchdog_msgs/ActionStamped": HEADER + "watchdog_msgs/Action action\n",
    "mission_sequencer/MissionRequest": HEADER + "uint8 id\nuint8 request\n" + _constants(REQUESTS),
    "mission_sequencer/MissionResponse": HEADER
    + "mission_sequencer/MissionRequest request\nbool response\nbool completed\n",
    "mission_sequencer/MissionWaypoint": "float64 x\nfloat64 y\nfloat64 z\nfloat64 yaw\nfloat64 holdtime\n",
    "mission_sequencer/MissionWaypointStamped": HEADER + "mission_sequencer/MissionWaypoint waypoint\n",
    "mission_sequencer/MissionWaypointArray": HEADER
    + "mission_sequencer/MissionWaypoint[] waypoints\nuint8 action\n"
    + _constants("CLEAR=0 APPEND=1 INSERT=2")
    + "uint8 idx\nbool is_global\nuint8 reference\n"
    + _constants("GLOBAL=0 LOCAL=1 CUR_POS=2 CUR_POSE=3"),
}
SERVICES: Dict[str, Tuple[str, str]] = {
    "watchdog_msgs/Start": (
        HEADER + "float64 startup_time\n",
        HEADER + "bool successful\nwatchdog_msgs/Status status\nstring[] entity_ids\n",
    ),
    "std_srvs/Trigger": ("", "bool success\nstring message\n"),
    "std_srvs/SetBool": ("bool data\n", "bool success\nstring message\n"),
}
_BUILTIN = re.compile(r"(bool|u?int\d+|float\d+|string|time|duration)(\[\d*\])?")


def _md5_text(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    constants = [line for line in lines if "=" in line]
    fields = []
    for line in lines:
        if "=" in line:
            continue
        kind, name = line.split()
        fields.append(line if _BUILTIN.fullmatch(kind) else f"{md5(kind.split('[')[0])} {name}")
    return "\n".join([*constants, *fields])


def md5(name: str) -> str:
    """Return the md5 sum of a message."""
    return hashlib.md5(_md5_text(MESSAGES[name]).encode()).hexdigest()


def service_md5(name: str) -> str:
    """Return the md5 sum of a service."""
    return hashlib.md5("".join(map(_md5_text, SERVICES[name])).encode()).hexdigest()


def _full(text: str) -> str:
    """Return a definition followed by those that it includes, as genpy wants it."""
    needed: List[str] = []

    def find(inner: str) -> None:
        for name, definition in MESSAGES.items():
            if re.search(rf"(^|\n){name}[ \[]", inner) and name not in needed:
                needed.append(name)
                find(definition)

    find(text)
    return f"{'=' * 80}\n".join([text, *(f"MSG: {name}\n{MESSAGES[name]}" for name in needed)])


def classes(package: str, part: str) -> Dict[str, Any]:
    """Return the classes of a package's msg or srv by name."""
    import genpy.dynamic  # noqa: PLC0415

    def build(name: str, text: str) -> Any:
        return genpy.dynamic.generate_dynamic(name, _full(text))[name]

    def of(names: Any) -> List[Tuple[str, str]]:
        return [(name, name.split("/")[1]) for name in names if name.startswith(f"{package}/")]

    if part == "msg":
        return {short: build(name, MESSAGES[name]) for name, short in of(MESSAGES)}
    found: Dict[str, Any] = {}
    for name, short in of(SERVICES):
        asked, answered = (build(f"{name}{end}", text) for end, text in zip(("Request", "Response"), SERVICES[name]))
        fields = {
            "_type": name,
            "_md5sum": service_md5(name),
            "_request_class": asked,
            "_response_class": answered,
        }
        found.update({short: type(short, (), fields), f"{short}Request": asked, f"{short}Response": answered})
    return found


_MODULE = """\
from cns_definitions import classes
globals().update(classes("{0}", "{1}"))
"""


def install(folder: Path) -> str:
    """Write the packages that Debian does not have; return what PYTHONPATH must hold for them."""
    for package in PACKAGES:
        (folder / package).mkdir()
        (folder / package / "__init__.py").write_text("")
        for part in ("msg", "srv"):
            (folder / package / f"{part}.py").write_text(_MODULE.format(package, part))
    return f"{folder}:{Path(__file__).parent}"


_PACKAGE = """\
<package format="2">
  <name>{0}</name><version>0.0.0</version><description>Messages alone</description>
  <maintainer email="nobody@example.org">nobody</maintainer><license>none</license>
  <buildtool_depend>catkin</buildtool_depend>
  <depend>std_msgs</depend><build_depend>message_generation</build_depend><exec_depend>message_runtime</exec_depend>
</package>
"""
_CMAKE = """\
cmake_minimum_required(VERSION 3.0.2)
project({0})
find_package(catkin REQUIRED COMPONENTS message_generation std_msgs)
{1}
generate_messages(DEPENDENCIES std_msgs)
catkin_package(CATKIN_DEPENDS message_runtime std_msgs)
"""


def sources(folder: Path) -> None:
    """Write them as a workspace has them: package.xml, CMakeLists.txt, .msg and .srv."""
    texts = {"msg": MESSAGES, "srv": {name: "---\n".join(parts) for name, parts in SERVICES.items()}}
    for package in PACKAGES:
        added: List[str] = []
        for end, kind in (("msg", "message"), ("srv", "service")):
            own = {name.split("/")[1]: text for name, text in texts[end].items() if name.startswith(f"{package}/")}
            (folder / package / end).mkdir(parents=True)
            for name, text in own.items():
                (folder / package / end / f"{name}.{end}").write_text(text)
            if own:
                added.append(f"add_{kind}_files(FILES {' '.join(f'{name}.{end}' for name in own)})")
        (folder / package / "package.xml").write_text(_PACKAGE.format(package))
        (folder / package / "CMakeLists.txt").write_text(_CMAKE.format(package, "\n".join(added)))
