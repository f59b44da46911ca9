"""A driver of simulated sensors: a real ROS node that reads its device and publishes what it says.

It is killed, stopped and restarted like any driver. Its device is one end of a socket pair (SOCK_SEQPACKET) that the
simulated world holds the other end of: first a packet of JSON, [[topic, type], ...]; then a packet per message, the
number of its topic (uint16, little endian) and the serialized message. It ends when the world has closed its end.

    python -m amaze_autonomy.nodes.simulation.driver_process DESCRIPTOR __name:=NAME
"""

from __future__ import annotations

import json
import socket
import struct
import sys
from contextlib import suppress
from functools import partial
from typing import Any, List

import roslib.message
import rospy

from amaze_autonomy.ros.errors import StartError
from amaze_autonomy.ros.rospy_flaws import check_master_uri, mend_rospy

NUMBER = struct.Struct("<H")
MOST_BYTES = 1 << 17
_QUEUE = 10


def main(argv: List[str]) -> int:
    """Publish what the device says until it is gone; return the exit status."""
    try:
        check_master_uri()
    except StartError as error:
        print(f"simulated_driver: {error}", file=sys.stderr, flush=True)
        return 2
    device = socket.socket(fileno=int(argv[1]))
    device.setblocking(True)  # rospy gives every socket of its process a time limit, which outlives the process
    topics = json.loads(device.recv(MOST_BYTES))
    mend_rospy()
    rospy.init_node("simulated_driver")
    rospy.on_shutdown(partial(device.shutdown, socket.SHUT_RDWR))  # wakes it while it waits for its device
    publishers = [_publisher(*each) for each in topics]
    _forget(device)
    while True:
        packet = device.recv(MOST_BYTES)
        if not packet:
            return 0
        message = rospy.AnyMsg()
        message.deserialize(packet[NUMBER.size :])
        publishers[NUMBER.unpack_from(packet)[0]].publish(message)


def _publisher(topic: str, type_name: str) -> Any:
    return rospy.Publisher(topic, roslib.message.get_message_class(type_name), queue_size=_QUEUE, tcp_nodelay=True)


def _forget(device: socket.socket) -> None:
    """Throw away what the device said while the node was starting."""
    with suppress(BlockingIOError):
        while device.recv(MOST_BYTES, socket.MSG_DONTWAIT):
            pass


if __name__ == "__main__":
    sys.exit(main(sys.argv))
