"""All peers of an autonomy node, played as fast as it can decide: a flight takes a quarter of a second."""

from __future__ import annotations

import io
import socket
import struct
import threading
import time
from math import nan
from typing import Any, Callable, Dict, Optional, Tuple

import rosgraph
import rospy
from rosgraph.network import decode_ros_handshake_header, encode_ros_handshake_header
from std_srvs.srv import TriggerResponse

from amaze_autonomy import msg, srv
from amaze_autonomy.interface import STATUSES
from amaze_autonomy.ros.interface import SERVICE_CLASSES, message_class

_PERIOD_S = 0.2
_ROW = msg.Check(name="bench", verdict=msg.Check.PASS, value=nan, limit=nan, age=nan)


class WireService:
    """A service that notes when the bytes of each request arrive.

    Args:
        name: of the service.
        service: its class.
        answer: makes the response of (request, monotonic nanoseconds of its arrival).
    """

    def __init__(self, name: str, service: Any, answer: Callable[[Any, int], Any]) -> None:
        self._service, self._answer = service, answer
        self._listener = socket.create_server(("127.0.0.1", 0))
        uri = f"rosrpc://127.0.0.1:{self._listener.getsockname()[1]}"
        rosgraph.Master("/bench_wire").registerService(name, uri, "http://127.0.0.1:1/")
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            connection, _ = self._listener.accept()
            connection.settimeout(None)  # rospy has set another default
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        size = connection.recv(4)
        decode_ros_handshake_header(size + connection.recv(struct.unpack("<I", size)[0]))
        header = {"callerid": "/bench_wire", "md5sum": self._service._md5sum, "type": self._service._type}
        connection.sendall(encode_ros_handshake_header(header))
        while True:
            try:
                data = connection.recv(65536)
            except ConnectionResetError:
                return
            arrived_ns = time.monotonic_ns()
            if not data:
                return
            request = self._service._request_class().deserialize(data[4:])
            body = io.BytesIO()
            self._answer(request, arrived_ns).serialize(body)
            connection.sendall(struct.pack("<BI", 1, len(body.getvalue())) + body.getvalue())


class Peers:
    """The vehicle and everything around it, as far as an engine can tell.

    Args:
        namespace: of the autonomy node.
        platforms: that record.
    """

    def __init__(self, namespace: str, platforms: Tuple[str, ...]) -> None:
        self._namespace, self._platforms = namespace, platforms
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._publishers = {
            status.topic: rospy.Publisher(
                f"{namespace}/{status.topic}", message_class(status), queue_size=1, tcp_nodelay=True
            )
            for status in STATUSES
        }
        self._number = 0
        self.code = 1
        self.landing: Optional[int] = None
        self.state = self._said = ""
        self._mission = msg.MissionStatus(distance_left=nan, time_left=nan, waypoints=2)
        self._recording = msg.RecordingStatus(progress=nan)
        self._autopilot = msg.AutopilotStatus(
            armed_known=True,
            landed=msg.AutopilotStatus.ON_GROUND,
            mode="AUTO.LOITER",
            height_valid=True,
            position_valid=True,
            battery_fraction=0.9,
            battery_voltage=16.0,
        )
        rospy.Subscriber(f"{namespace}/autonomy/state", msg.AutonomyState, self._see)
        for name, service in SERVICE_CLASSES.items():
            WireService(f"{namespace}/{name}", service, self._answers()[name])
        threading.Thread(target=self._stream, daemon=True).start()

    # --- statuses -------------------------------------------------------------------------------------------------

    def _see(self, message: Any) -> None:
        with self._changed:
            self.state, self._said = message.state, message.message
            self._changed.notify_all()

    def wait(self, condition: Callable[[], bool], what: str, limit_s: float = 20.0) -> None:
        """Wait until something is so."""
        with self._changed:
            if not self._changed.wait_for(condition, limit_s):
                raise SystemExit(f"latency: {what} did not come, the engine is in {self.state}: {self._said}")

    def wait_for_listeners(self, count: int) -> None:
        """Wait until so many nodes listen to every status."""
        publishers = self._publishers.values()
        self.wait(lambda: all(each.get_num_connections() >= count for each in publishers), f"{count} listeners")

    def _stream(self) -> None:
        pause = threading.Event()
        while not pause.wait(_PERIOD_S):
            self.publish()

    def publish(self) -> None:
        """Publish every status as it is now."""
        with self._lock:
            now = rospy.Time.now()
            on_ground = self._autopilot.landed == msg.AutopilotStatus.ON_GROUND
            landed = msg.Landed(landed=1 if on_ground else 2, distance=0.0)
            for name, message in (
                ("mission_planner/status", self._mission),
                ("data_recorder/status", self._recording),
                ("autopilot/status", self._autopilot),
                ("landing_detection/landed", landed),
            ):
                message.header.stamp = now
                self._publishers[name].publish(message)
            self.heartbeat()

    def heartbeat(self) -> int:
        """Publish the watchdog's action; return when it went out, in monotonic nanoseconds."""
        with self._lock:
            self._number += 1
            bad = [msg.ComponentState(name="mission_camera", code=self.code, until=nan)] if self.code > 1 else []
            message = msg.WatchdogAction(
                sequence=self._number, loop_counter=self._number, code=self.code, components=bad
            )
            message.header.stamp = rospy.Time.now()
            publisher = self._publishers["watchdog/action"]
            sent_ns = time.monotonic_ns()
            publisher.publish(message)
            return sent_ns

    # --- services -------------------------------------------------------------------------------------------------

    def _answers(self) -> Dict[str, Callable[[Any, int], Any]]:
        return {
            "watchdog/start": lambda *_: srv.StartWatchdogResponse(ready=True, until=nan, checks=[_ROW]),
            "autopilot/check_battery": lambda *_: srv.CheckBatteryResponse(ok=True, fraction=0.9, checks=[_ROW]),
            "autopilot/check": lambda *_: srv.CheckAutopilotResponse(ok=True, checks=[_ROW]),
            "landing_detection/check": lambda *_: srv.CheckLandedResponse(on_ground=True, checks=[_ROW]),
            "state_estimation/check": lambda *_: srv.CheckStateResponse(valid=True, checks=[_ROW]),
            "mission_planner/load": self._load,
            "mission_planner/command": self._command,
            "data_recorder/start": self._start,
            "data_recorder/stop": self._stop,
            "autopilot/land": lambda *_: TriggerResponse(success=True),
            "autopilot/disarm": lambda *_: TriggerResponse(success=True),
        }

    def _start(self, request: Any, _: int) -> Any:
        with self._lock:
            growing = [msg.PlatformRecording(platform=name, growing=True, bytes=1) for name in self._platforms]
            self._recording.session_id, self._recording.phase = request.session_id, msg.RecordingStatus.RECORDING
            self._recording.platforms = growing
            self.publish()
        return srv.StartRecordingResponse(accepted=True)

    def _stop(self, _: Any, __: int) -> Any:
        with self._lock:
            self._recording.phase, self._recording.location = msg.RecordingStatus.COMPLETE, "nowhere"
            self._recording.platforms = []
            self.publish()
        return srv.StopRecordingResponse(accepted=True)

    def _load(self, request: Any, _: int) -> Any:
        with self._lock:
            self._mission.session_id, self._mission.mission_id = request.session_id, request.mission_id
            self._mission.phase, self._mission.waypoint = msg.MissionStatus.LOADED, 0
            self.publish()
        return srv.LoadMissionResponse(accepted=True, waypoints=2, estimated_duration=nan)

    def _command(self, request: Any, arrived_ns: int) -> Any:
        if request.command == srv.MissionCommandRequest.LAND:
            with self._changed:
                self.landing = self.landing or arrived_ns
                self._changed.notify_all()
        elif request.command == srv.MissionCommandRequest.TAKEOFF:
            self.fly()
        return srv.MissionCommandResponse(accepted=True)

    # --- the vehicle ----------------------------------------------------------------------------------------------

    def fly(self) -> None:
        """Be in the air at once."""
        with self._lock:
            self._mission.phase = msg.MissionStatus.TAKING_OFF
            self._autopilot.armed, self._autopilot.landed = True, msg.AutopilotStatus.IN_AIR
            self._autopilot.mode, self._autopilot.height = "AUTO.TAKEOFF", 2.0
            self.publish()
            self._mission.phase, self._mission.waypoint = msg.MissionStatus.FLYING, 1
            self._autopilot.mode = "AUTO.MISSION"
            self.publish()

    def fail(self) -> int:
        """Send a code 16; return when it went out, in monotonic nanoseconds."""
        with self._lock:
            self.code = 16
            return self.heartbeat()

    def touch_down(self) -> None:
        """Be on the ground, disarmed, with everything well again."""
        with self._lock:
            self.code, self.landing = 1, None
            self._mission.phase = msg.MissionStatus.LANDED
            self._autopilot.armed, self._autopilot.landed = False, msg.AutopilotStatus.ON_GROUND
            self._autopilot.mode, self._autopilot.height = "AUTO.LAND", 0.0
            self.publish()
