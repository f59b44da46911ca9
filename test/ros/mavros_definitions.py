"""The message classes of mavros_msgs that the tests need: the installed ones, else made here by the same definitions.

Debian does not package mavros. So the fields and constants of the interface stand here, as releases of mavros 1.x have
them; the md5 sums, taken from code that was generated from those, show that they are the same. `install(folder)` writes
a package `mavros_msgs` for who has none.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any, Dict, Iterable, Iterator, Tuple

MD5 = {
    "CommandLong": "eb9034afc87577c0a235d45b8f3437d2",
    "EstimatorStatus": "39dbcc4be3f04b68422f784827c47dd5",
    "ExtendedState": "ae780b1800fe17b917369d21b90058bd",
    "GPSRAW": "386bdffbf0a2d0436562395d516aa9bd",
    "HomePosition": "c1167922de8c97acdb0ec714c1dba774",
    "Mavlink": "41093e1fd0f3eea1da2aa33a177e5ba6",
    "ParamGet": "777d24d2a7ab1765ef009a69f464d2bc",
    "ParamValue": "e2cb1c7a0f6ef0c62d450cd9362c980d",
    "PositionTarget": "dedb0081aaf8cb20209737746bb49117",
    "RCIn": "1c3eafdb5efbcda3c334e1788bbcfe39",
    "SetMode": "e4f18fa93379f9ff1780d270ce110203",
    "State": "65cd0a9fff993b062b91e354554ec7e9",
    "StatusText": "6cfd33cd09e4abf5841d7be3c770a969",
    "SysStatus": "4039be26d76b32d20c569c754da6e25c",
    "Waypoint": "7a0d2b53dcd6b7aff0aa748703e85e92",
    "WaypointList": "2cacdc0c2c212eb99fdee9f12d2e1fa4",
    "WaypointPull": "a8d9ecef8fb37028d2db2a9aa4ed7e79",
    "WaypointPush": "5b2bca74e830798e1579b58cafd50527",
    "WaypointReached": "1cf64d072d9f6aa0a6715922bdde6a35",
    "WaypointSetCurrent": "f99aa1a911a80ab546ea470f4e90c807",
}
"""Of each type, as others know it."""

COPTER_MODES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    5: "LOITER",
    6: "RTL",
    7: "CIRCLE",
    9: "LAND",
    11: "DRIFT",
    13: "SPORT",
    14: "FLIP",
    15: "AUTOTUNE",
    16: "POSHOLD",
    17: "BRAKE",
    18: "THROW",
    19: "AVOID_ADSB",
    20: "GUIDED_NOGPS",
}
"""Of an ArduCopter, as mavros 1.x names them; it says CMODE(number) of any other."""

ESTIMATOR_FLAGS = (
    "attitude",
    "velocity_horiz",
    "velocity_vert",
    "pos_horiz_rel",
    "pos_horiz_abs",
    "pos_vert_abs",
    "pos_vert_agl",
    "const_pos_mode",
    "pred_pos_horiz_rel",
    "pred_pos_horiz_abs",
    "gps_glitch",
    "accel_error",
)
"""Of EstimatorStatus, in the order of their bits in ESTIMATOR_STATUS; each name ends in _status_flag."""


def _fields(kind: str, names: str) -> str:
    return "".join(f"{kind} {name}\n" for name in names.split())


def _constants(prefix: str, names: str, first: int = 0, kind: str = "uint8") -> str:
    """Return constants that count up; NAME=7 goes on from 7."""
    lines, number = [], first
    for each in names.split():
        name, _, value = each.partition("=")
        number = int(value) if value else number
        lines.append(f"{kind} {prefix}{name}={number}\n")
        number += 1
    return "".join(lines)


def _modes(vehicle: str, names: str) -> str:
    """Return the names of flight modes; NAME=WORD where mavros says another word than the constant's name."""
    pairs = (each.partition("=") for each in names.split())
    return "".join(f"string MODE_{vehicle}_{name}={word or name}\n" for name, _, word in pairs)


HEADER = "std_msgs/Header header\n"
_POWERS = [("PX", 1), ("PY", 2), ("PZ", 4), ("VX", 8), ("VY", 16), ("VZ", 32), ("AFX", 64), ("AFY", 128), ("AFZ", 256)]
MESSAGES = {
    "State": HEADER
    + _fields("bool", "connected armed guided manual_input")
    + "string mode\nuint8 system_status\n"
    + _modes(
        "APM_PLANE",
        "MANUAL CIRCLE STABILIZE TRAINING ACRO FBWA FBWB CRUISE AUTOTUNE AUTO RTL LOITER LAND GUIDED INITIALISING "
        "QSTABILIZE QHOVER QLOITER QLAND QRTL",
    )
    + _modes(
        "APM_COPTER",
        "STABILIZE ACRO ALT_HOLD AUTO GUIDED LOITER RTL CIRCLE POSITION LAND OF_LOITER DRIFT SPORT FLIP AUTOTUNE "
        "POSHOLD BRAKE THROW AVOID_ADSB GUIDED_NOGPS",
    )
    + _modes("APM_ROVER", "MANUAL LEARNING STEERING HOLD AUTO RTL GUIDED INITIALISING")
    + _modes(
        "PX4",
        "MANUAL ACRO ALTITUDE=ALTCTL POSITION=POSCTL OFFBOARD STABILIZED RATTITUDE MISSION=AUTO.MISSION "
        "LOITER=AUTO.LOITER RTL=AUTO.RTL LAND=AUTO.LAND RTGS=AUTO.RTGS READY=AUTO.READY TAKEOFF=AUTO.TAKEOFF",
    ),
    "ExtendedState": _constants("VTOL_STATE_", "UNDEFINED TRANSITION_TO_FW TRANSITION_TO_MC MC FW")
    + _constants("LANDED_STATE_", "UNDEFINED ON_GROUND IN_AIR TAKEOFF LANDING")
    + HEADER
    + _fields("uint8", "vtol_state landed_state"),
    "SysStatus": HEADER
    + _fields("uint32", "sensors_present sensors_enabled sensors_health")
    + _fields("uint16", "load voltage_battery")
    + "int16 current_battery\nint8 battery_remaining\n"
    + _fields("uint16", "drop_rate_comm errors_comm errors_count1 errors_count2 errors_count3 errors_count4"),
    "StatusText": _constants("", "EMERGENCY ALERT CRITICAL ERROR WARNING NOTICE INFO DEBUG")
    + HEADER
    + "uint8 severity\nstring text\n",
    "EstimatorStatus": HEADER + "".join(f"bool {name}_status_flag\n" for name in ESTIMATOR_FLAGS),
    "GPSRAW": HEADER
    + _constants("GPS_FIX_TYPE_", "NO_GPS NO_FIX 2D_FIX 3D_FIX DGPS RTK_FLOATR RTK_FIXEDR STATIC PPP")
    + "uint8 fix_type\n"
    + _fields("int32", "lat lon alt")
    + _fields("uint16", "eph epv vel cog")
    + "uint8 satellites_visible\nint32 alt_ellipsoid\n"
    + _fields("uint32", "h_acc v_acc vel_acc")
    + "int32 hdg_acc\nuint8 dgps_numch\nuint32 dgps_age\n",
    "HomePosition": HEADER
    + "geographic_msgs/GeoPoint geo\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
    + "geometry_msgs/Vector3 approach\n",
    "Mavlink": _constants("FRAMING_", "OK BAD_CRC BAD_SIGNATURE", 1)
    + _constants("MAVLINK_", "V10=254 V20=253")
    + HEADER
    + _fields("uint8", "framing_status magic len incompat_flags compat_flags seq sysid compid")
    + "uint32 msgid\nuint16 checksum\nuint64[] payload64\nuint8[] signature\n",
    "ParamValue": "int64 integer\nfloat64 real\n",
    "Waypoint": "uint8 frame\n"
    + _constants("FRAME_", "GLOBAL LOCAL_NED MISSION GLOBAL_REL_ALT LOCAL_ENU")
    + "uint16 command\nbool is_current\nbool autocontinue\n"
    + _fields("float32", "param1 param2 param3 param4")
    + _fields("float64", "x_lat y_long z_alt"),
    "WaypointList": "uint16 current_seq\nmavros_msgs/Waypoint[] waypoints\n",
    "WaypointReached": HEADER + "uint16 wp_seq\n",
    "RCIn": HEADER + "uint8 rssi\nuint16[] channels\n",
    "PositionTarget": HEADER
    + "uint8 coordinate_frame\n"
    + _constants("FRAME_", "LOCAL_NED=1 LOCAL_OFFSET_NED=7 BODY_NED BODY_OFFSET_NED")
    + "uint16 type_mask\n"
    + "".join(f"uint16 IGNORE_{name}={bit}\n" for name, bit in _POWERS)
    + "uint16 FORCE=512\nuint16 IGNORE_YAW=1024\nuint16 IGNORE_YAW_RATE=2048\n"
    + "geometry_msgs/Point position\ngeometry_msgs/Vector3 velocity\ngeometry_msgs/Vector3 acceleration_or_force\n"
    + "float32 yaw\nfloat32 yaw_rate\n",
}
SERVICES = {
    "SetMode": (
        _constants(
            "MAV_MODE_",
            "PREFLIGHT STABILIZE_DISARMED=80 STABILIZE_ARMED=208 MANUAL_DISARMED=64 MANUAL_ARMED=192 "
            "GUIDED_DISARMED=88 GUIDED_ARMED=216 AUTO_DISARMED=92 AUTO_ARMED=220 TEST_DISARMED=66 TEST_ARMED=194",
        )
        + "uint8 base_mode\nstring custom_mode\n",
        "bool mode_sent\n",
    ),
    "CommandLong": (
        "bool broadcast\nuint16 command\nuint8 confirmation\n" + "".join(f"float32 param{n}\n" for n in range(1, 8)),
        "bool success\nuint8 result\n",
    ),
    "ParamGet": ("string param_id\n", "bool success\nmavros_msgs/ParamValue value\n"),
    "WaypointPush": ("uint16 start_index\nmavros_msgs/Waypoint[] waypoints\n", "bool success\nuint32 wp_transfered\n"),
    "WaypointPull": ("", "bool success\nuint32 wp_received\n"),
    "WaypointSetCurrent": ("uint16 wp_seq\n", "bool success\n"),
}
_LINE = "=" * 80
_INCLUDED = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id\n",
    "geographic_msgs/GeoPoint": "float64 latitude\nfloat64 longitude\nfloat64 altitude\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "mavros_msgs/Waypoint": MESSAGES["Waypoint"],
    "mavros_msgs/ParamValue": MESSAGES["ParamValue"],
}
_MODULE = """\
from mavros_definitions import made
globals().update(made("{0}"))
"""


def _full(text: str) -> str:
    """Return a definition followed by those that it includes, as genpy wants it."""
    included = (
        f"MSG: {name}\n{inner}" for name, inner in _INCLUDED.items() if f"{name} " in text or f"{name}[" in text
    )
    return f"{_LINE}\n".join([text, *included])


def made(part: str) -> Dict[str, Any]:
    """Return the classes of mavros_msgs.msg or mavros_msgs.srv by name."""
    return dict(_messages(MESSAGES.items()) if part == "msg" else _services())


def _messages(definitions: Iterable[Tuple[str, str]]) -> Iterator[Tuple[str, Any]]:
    import genpy.dynamic  # noqa: PLC0415

    for name, text in definitions:
        yield name, genpy.dynamic.generate_dynamic(f"mavros_msgs/{name}", _full(text))[f"mavros_msgs/{name}"]


def _services() -> Iterator[Tuple[str, Any]]:
    for name, (request, response) in SERVICES.items():
        pair = dict(_messages(((f"{name}Request", request), (f"{name}Response", response))))
        fields = {
            "_type": f"mavros_msgs/{name}",
            "_md5sum": _service_md5(name, request, response),
            "_request_class": pair[f"{name}Request"],
            "_response_class": pair[f"{name}Response"],
        }
        yield from {name: type(name, (), fields), **pair}.items()


def _service_md5(name: str, request: str, response: str) -> str:
    import genmsg  # noqa: PLC0415
    from genmsg import gentools, msg_loader  # noqa: PLC0415

    context = genmsg.MsgContext.create_default()
    for included, text in _INCLUDED.items():
        context.register(included, msg_loader.load_msg_from_string(context, text, included))
    spec = msg_loader.load_srv_from_string(context, f"{request}---\n{response}", f"mavros_msgs/{name}")
    return str(gentools.compute_md5(context, spec))


def install(folder: Path) -> str:
    """Write the package where there is none; return what PYTHONPATH must hold for it."""
    beside = str(Path(__file__).parent)
    if importlib.util.find_spec("mavros_msgs") is not None:
        return beside
    package = folder / "mavros_msgs"
    package.mkdir()
    (package / "__init__.py").write_text("")
    for part in ("msg", "srv"):
        (package / f"{part}.py").write_text(_MODULE.format(part))
    return f"{folder}:{beside}"
