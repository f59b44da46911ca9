"""Lets a node accept a connection while another one says nothing.

rospy reads the header of a new connection on the thread that accepts all of them. Whoever connects and says nothing
keeps everybody else out for 60 s, its limit: the console's command to land, a recorder, a check. A half-open connection
does so, a port scan, and any node that subscribes to a topic of which a dead node is still on the master's list, when
the dead one's port is ours by now: it asks there in another protocol (http://wiki.ros.org/ROS/Slave_API), and waits.
"""

from __future__ import annotations

import threading
from typing import Any

from rospy.impl.tcpros_base import TCPROSServer

__all__ = ["accept_at_once"]


def accept_at_once() -> None:
    """Read the header of each connection on a thread of its own; call it before `rospy.init_node`."""
    TCPROSServer._tcp_server_callback = _accept


_read = TCPROSServer._tcp_server_callback


def _accept(server: Any, sock: Any, address: Any) -> None:
    threading.Thread(target=_read, args=(server, sock, address), name="inbound", daemon=True).start()
