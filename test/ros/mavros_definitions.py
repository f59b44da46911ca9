"""The message classes of mavros_msgs that the tests need, from definitions written here: Debian does not package them.

`install(folder)` writes a package `mavros_msgs` that makes them by genpy; with it on its path a node imports it.
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["ESTIMATOR_FLAGS", "install"]

#: of EstimatorStatus, in the order of their bits in ESTIMATOR_STATUS; each name ends in _status_flag
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
HEADER = "std_msgs/Header header\n"
MESSAGES = {
    "State": HEADER + "bool connected\nbool armed\nbool guided\nbool manual_input\nstring mode\nuint8 system_status\n",
    "ExtendedState": HEADER + "uint8 vtol_state\nuint8 landed_state\n",
    "SysStatus": HEADER
    + "uint32 sensors_present\nuint32 sensors_enabled\nuint32 sensors_health\nuint16 load\n"
    + "uint16 voltage_battery\nint16 current_battery\nint8 battery_remaining\n",
    "StatusText": HEADER + "uint8 severity\nstring text\n",
    "EstimatorStatus": HEADER + "".join(f"bool {name}_status_flag\n" for name in ESTIMATOR_FLAGS),
    "GPSRAW": HEADER
    + "uint8 fix_type\nint32 lat\nint32 lon\nint32 alt\nuint16 eph\nuint16 epv\nuint16 vel\nuint16 cog\n"
    + "uint8 satellites_visible\n",
    "HomePosition": HEADER + "geometry_msgs/Point position\n",
    "ParamValue": "int64 integer\nfloat64 real\n",
    "Waypoint": "uint8 frame\nuint16 command\nbool is_current\nbool autocontinue\n"
    + "".join(f"float32 param{n}\n" for n in range(1, 5))
    + "float64 x_lat\nfloat64 y_long\nfloat64 z_alt\n",
    "WaypointList": "uint16 current_seq\nmavros_msgs/Waypoint[] waypoints\n",
    "WaypointReached": HEADER + "uint16 wp_seq\n",
    "PositionTarget": HEADER
    + "uint8 coordinate_frame\nuint16 type_mask\ngeometry_msgs/Point position\ngeometry_msgs/Vector3 velocity\n"
    + "geometry_msgs/Vector3 acceleration_or_force\nfloat32 yaw\nfloat32 yaw_rate\n",
}
SERVICES = {
    "SetMode": ("uint8 base_mode\nstring custom_mode\n", "bool mode_sent\n"),
    "CommandLong": (
        "bool broadcast\nuint16 command\nuint8 confirmation\n" + "".join(f"float32 param{n}\n" for n in range(1, 8)),
        "bool success\nuint8 result\n",
    ),
    "ParamGet": ("string param_id\n", "bool success\nParamValue value\n"),
    "WaypointPush": ("uint16 start_index\nmavros_msgs/Waypoint[] waypoints\n", "bool success\nuint32 wp_transfered\n"),
    "WaypointPull": ("", "bool success\nuint32 wp_received\n"),
    "WaypointSetCurrent": ("uint16 wp_seq\n", "bool success\n"),
}
_LINE = "=" * 80
_INCLUDED = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
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
    parts = [text]
    for name, inner in _INCLUDED.items():
        if f"{name} " in text or f"{name}[" in text or f"\n{name.split('/')[1]} " in text:
            parts.append(f"MSG: {name}\n{inner}")
    return f"{_LINE}\n".join(parts)


def made(part: str):
    """Return the classes of mavros_msgs.msg or mavros_msgs.srv by name."""
    import genpy.dynamic  # noqa: PLC0415

    def build(name: str, text: str):
        return genpy.dynamic.generate_dynamic(f"mavros_msgs/{name}", _full(text))[f"mavros_msgs/{name}"]

    if part == "msg":
        return {name: build(name, text) for name, text in MESSAGES.items()}
    services = {}
    for name, (request, response) in SERVICES.items():
        asked, answered = build(f"{name}Request", request), build(f"{name}Response", response)
        fields = {
            "_type": f"mavros_msgs/{name}",
            "_md5sum": asked._md5sum,
            "_request_class": asked,
            "_response_class": answered,
        }
        services.update({name: type(name, (), fields), f"{name}Request": asked, f"{name}Response": answered})
    return services


def install(folder: Path) -> str:
    """Write the package; return what PYTHONPATH must hold for it."""
    package = folder / "mavros_msgs"
    package.mkdir()
    (package / "__init__.py").write_text("")
    for part in ("msg", "srv"):
        (package / f"{part}.py").write_text(_MODULE.format(part))
    return f"{folder}:{Path(__file__).parent}"
