"""Publishes the samples of the simulated sensors as real messages; the world only has plain values."""

from __future__ import annotations

import ctypes
import io
import json
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

import roslib.message
import rospy

from amaze_autonomy.monitoring.specs import ComponentSpec
from amaze_autonomy.ros.clock import Clock
from amaze_autonomy.simulation.sensors import Sample
from amaze_autonomy.simulation.streams import StreamSettings

from ...ros.interface import ros_time
from .driver_process import NUMBER

_QUEUE = 50


def fill(message: Any, fields: Mapping[str, Any]) -> Any:
    """Set fields of a message from plain values; a nested message is a mapping."""
    for name, value in fields.items():
        if isinstance(value, Mapping):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def message_of(sample: Sample, shift_ns: int) -> Any:
    """Return the message of a sample; `shift_ns` is ROS time less the clock of its stamp."""
    message = fill(roslib.message.get_message_class(sample.type_name)(), sample.fields)
    if hasattr(message, "header"):
        message.header.stamp = ros_time(max(0, sample.stamp_ns + shift_ns))
        message.header.frame_id = sample.frame_id
    return message


class SensorPublisher:
    """One publisher per topic, made when its first sample comes.

    Args:
        clock: that the samples' stamps are on; the messages are stamped in ROS time.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._publishers: Dict[str, Any] = {}

    def publish(self, samples: Iterable[Sample]) -> None:
        """Publish samples; of those that nobody listens to only the stamp is looked at."""
        shift_ns = self._clock.ros_ns() - self._clock.now_ns()
        for sample in samples:
            publisher = self._publisher(sample)
            if publisher.get_num_connections():
                publisher.publish(message_of(sample, shift_ns))

    def _publisher(self, sample: Sample) -> Any:
        publisher = self._publishers.get(sample.topic)
        if publisher is None:
            message = roslib.message.get_message_class(sample.type_name)
            publisher = self._publishers[sample.topic] = rospy.Publisher(sample.topic, message, queue_size=_QUEUE)
        return publisher


# --- simulated drivers ------------------------------------------------------------------------------------------------
# The drivers of the simulated sensors as processes of their own, under the names that the configuration gives them.
#  They are started, and started again whenever they end, as roslaunch does with `respawn`. A sensor without a node is
# published by the driver whose name its topic begins with (`/realsense/imu` by `/realsense`), or by the world itself.
# A driver that somebody else has ended has restarted its device with it; one that a fault has killed has not.


_RESPAWN_S = 0.3
_END_S = 3.0
_DEVICE_BYTES = 1 << 16  # of the device's memory: what a driver that hangs finds when it goes on
_PR_SET_PDEATHSIG = 1


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


class _Driver:
    """One driver, and the device that it reads."""

    def __init__(self, node: str, components: Tuple[str, ...], topics: Sequence[Tuple[str, str]]) -> None:
        self.node, self.components, self._topics = node, components, list(topics)
        self._device: Optional[socket.socket] = None
        self._process: Optional[subprocess.Popen[bytes]] = None
        self._ended_s: Optional[float] = None
        self.killed = False

    def start(self) -> None:
        """Start the process, with a device of its own."""
        mine, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        mine.setblocking(False)
        mine.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _DEVICE_BYTES)
        mine.send(json.dumps(self._topics).encode())
        namespace, _, name = self.node.rpartition("/")
        command = [sys.executable, "-m", "amaze_autonomy.nodes.simulation.driver_process", str(its.fileno())]
        with its:
            self._process = subprocess.Popen(
                [*command, f"__name:={name}", f"__ns:={namespace or '/'}"],
                pass_fds=(its.fileno(),),
                start_new_session=True,
                preexec_fn=_end_with_parent,  # noqa: PLW1509 - it calls prctl alone
            )
        self._device, self._ended_s = mine, None

    def send(self, number: int, data: bytes) -> None:
        """Say a message; what a driver does not read is lost."""
        if self._device is not None:
            with suppress(OSError):
                self._device.send(NUMBER.pack(number) + data, socket.MSG_NOSIGNAL)

    def kill(self) -> None:
        """Kill the process, as a fault does."""
        if self._process is not None and self._process.poll() is None:
            self.killed = True
            self._process.kill()

    def came_back(self, now_s: float) -> bool:
        """Start it again when it has ended; return True when its device was restarted by that."""
        if self._process is None or self._process.poll() is None:
            return False
        if self._ended_s is None:
            self._ended_s = now_s
            self.unplug()
        if now_s - self._ended_s < _RESPAWN_S:
            return False
        by_fault, self.killed = self.killed, False
        rospy.logwarn("%s has ended and is started again", self.node)
        self.start()
        return not by_fault

    def end(self, limit_s: float) -> None:
        """Wait for its end; what has not ended by then is killed."""
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(limit_s)
            self._process.kill()
            self._process.wait()

    def unplug(self) -> None:
        """Take its device away: it ends by itself then, and the master forgets it."""
        if self._device is not None:
            self._device.close()
            self._device = None


class SimulatedDrivers:
    """Publishes samples like a `SensorPublisher`, those of components with a node by that node. Used by one thread.

    Args:
        components: what is watched.
        streams: the sensors of the world.
        clock: the node's.
        restarted: gets the name of each component whose driver was restarted.
    """

    def __init__(
        self,
        components: Sequence[ComponentSpec],
        streams: Sequence[StreamSettings],
        clock: Clock,
        restarted: Callable[[str], None],
    ) -> None:
        self._clock, self._restarted = clock, restarted
        self._rest = SensorPublisher(clock)
        self._drivers = _drivers(components, streams)
        self._routes: Dict[str, Tuple[_Driver, int]] = {}
        for driver, topics in self._drivers:
            self._routes.update({topic: (driver, number) for number, (topic, _) in enumerate(topics)})
        self._killed: Dict[str, bool] = {}

    def publish(self, samples: Iterable[Sample]) -> None:
        """Hand every sample to its driver."""
        shift_ns = self._clock.ros_ns() - self._clock.now_ns()
        rest: List[Sample] = []
        for sample in samples:
            if sample.topic not in self._routes:
                rest.append(sample)
                continue
            driver, number = self._routes[sample.topic]
            buffer = io.BytesIO()
            message_of(sample, shift_ns).serialize(buffer)
            driver.send(number, buffer.getvalue())
        self._rest.publish(rest)

    def look_after(self, troubles: Mapping[str, Tuple[str, ...]]) -> None:
        """Start, kill and start again what is to be.

        Args:
            troubles: kinds of the faults that act on each component.
        """
        now_s = time.monotonic()
        for driver, _ in self._drivers:
            dead = any("killed" in troubles.get(name, ()) for name in driver.components)
            if dead and not self._killed.get(driver.node):
                driver.kill()
            self._killed[driver.node] = dead
            if driver.came_back(now_s):
                for name in driver.components:
                    self._restarted(name)

    def start(self) -> None:
        """Start all drivers; they live as long as the thread that calls this."""
        for driver, _ in self._drivers:
            driver.start()

    def end(self) -> None:
        """End all drivers."""
        for driver, _ in self._drivers:
            driver.unplug()
        until_s = time.monotonic() + _END_S
        for driver, _ in self._drivers:
            driver.end(max(0.0, until_s - time.monotonic()))


def _drivers(
    components: Sequence[ComponentSpec], streams: Sequence[StreamSettings]
) -> List[Tuple[_Driver, List[Tuple[str, str]]]]:
    """Return each driver with its topics and their types."""
    nodes = list(dict.fromkeys(component.node for component in components if component.node))
    owner = {component.name: component.node for component in components if component.node}
    topics: Dict[str, List[Tuple[str, str]]] = {node: [] for node in nodes}
    names: Dict[str, List[str]] = {node: [] for node in nodes}
    for stream in streams:
        beginning = next((node for node in nodes if stream.topic.startswith(f"{node}/")), None)
        node = owner.get(stream.component) or beginning
        if node is not None:
            topics[node].append((rospy.resolve_name(stream.topic), stream.kind))
            if stream.component:
                names[node].append(stream.component)
    for name, node in owner.items():
        names[node].append(name)
    return [(_Driver(node, tuple(dict.fromkeys(names[node])), topics[node]), topics[node]) for node in nodes]
