"""A stand-in for mavros with a simulated PX4 or ArduPilot behind it: topics of its MAVLink, services that speak it."""

from __future__ import annotations

import contextlib
import copy
import math
import struct
import threading
import time

import rospy
from geometry_msgs.msg import PoseStamped, TwistStamped
from mavros_definitions import COPTER_MODES, ESTIMATOR_FLAGS
from pymavlink.dialects.v20 import common as mavlink
from sensor_msgs.msg import Imu, NavSatFix
from std_msgs.msg import Float64

from amaze_autonomy.autopilot.vehicle.modes import mode_name, px4_number
from amaze_autonomy.missions import FlightModel
from amaze_autonomy.simulation.ardupilot import ArduCraft, ArduPilot
from amaze_autonomy.simulation.px4 import Craft, Framing, Px4
from amaze_autonomy.simulation.vehicle.vehicle import Power, PowerSettings, VehicleSettings

_LIMIT_S, _LATE_S = 5.0, 0.005


class MavrosVehicle:
    """Both; the namespace is that of mavros.

    Args:
        namespace: e.g. /one/mavros.
        model: how the vehicle flies.
        messages: mavros_msgs.msg.
        services: mavros_msgs.srv.
        ardupilot: behind it is one.
    """

    def __init__(self, namespace, model: FlightModel, messages, services, *, ardupilot=False):
        self.lock, self.ended = threading.RLock(), threading.Event()
        craft, vehicle = (ArduCraft, ArduPilot) if ardupilot else (Craft, Px4)
        self.craft, self._ardupilot = craft(VehicleSettings(model=model), time.monotonic_ns()), ardupilot
        self.px4 = vehicle(self.craft, Power(PowerSettings()), time.monotonic_ns(), unix_ns=time.time_ns())
        self.px4.connect("mavros")
        self._framing, self._messages, self._services = Framing(255, 191), messages, services
        self._sent = Framing(1, 1)
        self._received = rospy.Publisher(
            f"{namespace.rpartition('/')[0]}/mavlink/from", messages.Mavlink, queue_size=100
        )
        self._waypoints, self._current, self._heard, self.called = (), 0, [], []
        self.spoils = 0  # pushes in which a waypoint is changed on its way
        kinds = {
            "state": messages.State,
            "extended_state": messages.ExtendedState,
            "estimator_status": messages.EstimatorStatus,
            "local_position/pose": PoseStamped,
            "local_position/velocity_local": TwistStamped,
            "imu/data": Imu,
            "global_position/global": NavSatFix,
            "global_position/rel_alt": Float64,
            "mission/waypoints": messages.WaypointList,
            "mission/reached": messages.WaypointReached,
            "statustext/recv": messages.StatusText,
        }
        self._publishers = {
            topic: rospy.Publisher(f"{namespace}/{topic}", kind, queue_size=10, latch=topic == "mission/waypoints")
            for topic, kind in kinds.items()
        }
        self._served = [
            rospy.Service(f"{namespace}/{name}", kind, answer)
            for name, kind, answer in (
                ("set_mode", services.SetMode, self.set_mode),
                ("cmd/command", services.CommandLong, self.command),
                ("mission/push", services.WaypointPush, self.push),
                ("mission/pull", services.WaypointPull, self.pull),
                ("mission/set_current", services.WaypointSetCurrent, self.set_current),
            )
        ]
        rospy.Subscriber(f"{namespace}/setpoint_raw/local", messages.PositionTarget, self.set_point)
        threading.Thread(target=self._run, daemon=True).start()

    def stop(self):
        """End it."""
        self.ended.set()
        for service in self._served:
            service.shutdown()

    # --- MAVLink --------------------------------------------------------------------------------------------------

    def _run(self):
        while not self.ended.wait(0.02):
            with contextlib.suppress(rospy.ROSException):
                self._step()

    def _step(self):
        with self.lock:
            now_ns = time.monotonic_ns()
            self.craft.advance(now_ns)
            said = [message for _, message in self.px4.advance(now_ns)]
            answers = [each for each in said if each.get_type().startswith(("MISSION_", "COMMAND_ACK"))]
            self._heard = [*self._heard, *answers][-500:]
            for message in said:
                self._publish_received(self._sent.encode(message))
                make = _MAKES.get(message.get_type())
                if make is not None:
                    make(self, message)

    def _send(self, message):
        """Send as on a wire, with a source."""
        with self.lock:
            for decoded in Framing(1, 1).decode(self._framing.encode(message)):
                self.px4.receive(time.monotonic_ns(), "mavros", decoded)

    def _wait(self, *names, seq=None):
        """Return the next message of these names; services wait beside each other, so the others stay."""
        deadline_s = time.monotonic() + _LIMIT_S
        while time.monotonic() < deadline_s:
            with self.lock:
                for number, message in enumerate(self._heard):
                    if message.get_type() in names and (seq is None or message.seq == seq):
                        return self._heard.pop(number)
            time.sleep(0.002)
        return None

    # --- services -------------------------------------------------------------------------------------------------

    def set_mode(self, request):
        self.called.append(request.custom_mode)
        if self._ardupilot:
            number = next(number for number, name in COPTER_MODES.items() if name == request.custom_mode)
            self._send(mavlink.MAVLink_set_mode_message(1, 1, number))
            return self._services.SetModeResponse(mode_sent=True)
        main, sub = px4_number(request.custom_mode)
        self._send(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, main, sub, 0, 0, 0, 0))
        return self._services.SetModeResponse(mode_sent=True)

    def command(self, request):
        parameters = [getattr(request, f"param{number}") for number in range(1, 8)]
        with self.lock:
            self._heard = [each for each in self._heard if each.get_type() != "COMMAND_ACK"]
            self._send(mavlink.MAVLink_command_long_message(1, 1, request.command, 0, *parameters))
        ack = self._wait("COMMAND_ACK")
        return self._services.CommandLongResponse(success=ack is not None and ack.result == 0, result=ack.result)

    def push(self, request):
        self.called.append("push")
        with self.lock:
            self._heard = [each for each in self._heard if not each.get_type().startswith("MISSION_")]
        waypoints, pushed = request.waypoints, copy.deepcopy(request.waypoints)
        if self.spoils:
            self.spoils -= 1
            waypoints[1].z_alt += 1.0
        self._send(mavlink.MAVLink_mission_count_message(1, 1, len(waypoints)))
        for number, each in enumerate(waypoints):
            if self._wait("MISSION_REQUEST", "MISSION_REQUEST_INT", seq=number) is None:
                return self._services.WaypointPushResponse(success=False, wp_transfered=number)
            self._send(_item(each, number))
        ack = self._wait("MISSION_ACK")
        self._waypoints = tuple(pushed)
        self._publish_behind_the_answer()
        return self._services.WaypointPushResponse(success=ack.type == 0, wp_transfered=len(waypoints))

    def pull(self, _):
        self.called.append("pull")
        self._send(mavlink.MAVLink_mission_request_list_message(1, 1))
        found = []
        for number in range(self._wait("MISSION_COUNT").count):
            self._send(mavlink.MAVLink_mission_request_int_message(1, 1, number))
            found.append(self._waypoint(self._wait("MISSION_ITEM_INT", seq=number)))
        self._waypoints = tuple(found)
        self._publish_behind_the_answer()
        return self._services.WaypointPullResponse(success=True, wp_received=len(found))

    def set_current(self, request):
        self.called.append("set_current")
        with self.lock:
            self._heard = [each for each in self._heard if each.get_type() != "MISSION_CURRENT"]
        self._send(mavlink.MAVLink_mission_set_current_message(1, 1, request.wp_seq))
        self._current = self._wait("MISSION_CURRENT", seq=request.wp_seq).seq
        self._publish_waypoints()
        return self._services.WaypointSetCurrentResponse(success=True)

    def set_point(self, message):
        place, speed = message.position, message.velocity
        numbers = (place.y, place.x, -place.z, speed.y, speed.x, -speed.z, 0, 0, 0, math.pi / 2 - message.yaw, 0)
        self._send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, message.coordinate_frame, message.type_mask, *numbers
            )
        )

    def _waypoint(self, item):
        parameters = {f"param{number}": getattr(item, f"param{number}") for number in range(1, 5)}
        place = {"x_lat": item.x * 1e-7, "y_long": item.y * 1e-7, "z_alt": item.z}
        flags = {"is_current": bool(item.current), "autocontinue": bool(item.autocontinue)}
        return self._messages.Waypoint(frame=item.frame, command=item.command, **flags, **parameters, **place)

    # --- topics ---------------------------------------------------------------------------------------------------

    def _publish_received(self, frame):
        """Publish what came from the vehicle, of MAVLink 2 without a signature, as mavros hands it on."""
        if not self._received.get_num_connections():
            return
        length, _, _, number, system, component = frame[1:7]
        padded = frame[10 : 10 + length].ljust(-(-length // 8) * 8, b"\xaa")
        payload = struct.unpack(f"<{len(padded) // 8}Q", padded)
        message = self._messages.Mavlink(framing_status=1, magic=frame[0], len=length, seq=number, sysid=system)
        message.compid, message.msgid, message.payload64 = component, int.from_bytes(frame[7:10], "little"), payload
        self._received.publish(message)

    def _publish(self, topic, message):
        self._publishers[topic].publish(message)

    def _publish_waypoints(self):
        self._publish("mission/waypoints", self._messages.WaypointList(self._current, list(self._waypoints)))

    def _publish_behind_the_answer(self):
        """Publish in a thread of its own, as mavros does: whoever called has the answer first."""
        late = self._messages.WaypointList(self._current, list(self._waypoints))
        threading.Timer(_LATE_S, self._publish, ("mission/waypoints", late)).start()

    def _heartbeat(self, said):
        state = self._messages.State(connected=True, armed=bool(said.base_mode & 128))
        number = said.custom_mode
        state.mode = COPTER_MODES.get(number, f"CMODE({number})") if self._ardupilot else mode_name(12, number)
        state.system_status = said.system_status
        self._publish("state", state)

    def _extended(self, said):
        self._publish("extended_state", self._messages.ExtendedState(landed_state=said.landed_state))

    def _estimator(self, said):
        flags = {f"{name}_status_flag": bool(said.flags >> bit & 1) for bit, name in enumerate(ESTIMATOR_FLAGS)}
        self._publish("estimator_status", self._messages.EstimatorStatus(**flags))

    def _local(self, said):
        pose, speed = PoseStamped(), TwistStamped()
        where, linear = pose.pose.position, speed.twist.linear
        where.x, where.y, where.z = said.y, said.x, -said.z
        pose.pose.orientation.w = 1.0  # as of a mavros that has heard no ATTITUDE
        linear.x, linear.y, linear.z = said.vy, said.vx, -said.vz
        self._publish("local_position/velocity_local", speed)
        self._publish("local_position/pose", pose)

    def _attitude(self, said):
        imu, yaw_rad = Imu(), math.pi / 2 - said.yaw
        imu.orientation.z, imu.orientation.w = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
        self._publish("imu/data", imu)

    def _global(self, said):
        self._publish("global_position/rel_alt", Float64(said.relative_alt / 1000))
        self._publish("global_position/global", NavSatFix(latitude=said.lat * 1e-7, longitude=said.lon * 1e-7))

    def _at(self, said):
        if said.seq != self._current:
            self._current = said.seq
            self._publish_waypoints()

    def _reached(self, said):
        self._publish("mission/reached", self._messages.WaypointReached(wp_seq=said.seq))

    def _text(self, said):
        self._publish("statustext/recv", self._messages.StatusText(severity=said.severity, text=said.text))


def _item(waypoint, number):
    parameters = [getattr(waypoint, f"param{index}") for index in range(1, 5)]
    place = round(waypoint.x_lat * 1e7), round(waypoint.y_long * 1e7), waypoint.z_alt
    flags = int(waypoint.is_current), int(waypoint.autocontinue)
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, number, waypoint.frame, waypoint.command, *flags, *parameters, *place
    )


_MAKES = {
    "HEARTBEAT": MavrosVehicle._heartbeat,
    "EXTENDED_SYS_STATE": MavrosVehicle._extended,
    "ESTIMATOR_STATUS": MavrosVehicle._estimator,
    "LOCAL_POSITION_NED": MavrosVehicle._local,
    "ATTITUDE": MavrosVehicle._attitude,
    "GLOBAL_POSITION_INT": MavrosVehicle._global,
    "MISSION_CURRENT": MavrosVehicle._at,
    "MISSION_ITEM_REACHED": MavrosVehicle._reached,
    "STATUSTEXT": MavrosVehicle._text,
}
