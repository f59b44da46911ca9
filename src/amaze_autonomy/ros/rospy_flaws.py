"""Mends what is wrong in rospy before a node starts.

A silent connection keeps all others out: rospy reads the header of a new connection on the thread that accepts them.
Whoever connects and says nothing keeps everybody else out for 60 s, its limit: the console's command to land, a
recorder, a check. A half-open connection does so, a port scan, and any node that subscribes to a topic of which a dead
node is still on the master's list, when the dead one's port is ours by now: it asks there in another protocol
(http://wiki.ros.org/ROS/Slave_API), and waits. Each header is read on a thread of its own; of too many of them the one
that has said nothing for the longest time is closed.

A node that can have no descriptor or thread, once, is closed to all for good: the thread that accepts connections ends
with the first error, and nobody sees it. It goes on.

So it is with connections to others: the thread that makes them ends with the first error, too, and who publishes later
is never heard. It goes on, and the reconnector asks again for what was missed.

A node cannot end well: rospy 1.15.9, which Debian 11 has, calls `Thread.isAlive`, which its Python 3.9 has no more. So
every node ended with a traceback and the status 1, whatever its own was.

A node that is told to end while it starts may run on for ever: rospy forgets a hook that is added while it calls the
others. The node has left the master then, so that nobody can reach it, and roslaunch starts no other one.

An address of the master that none can have is answered with "it may not be running yet", for ever: it is looked at.

Whoever logs may wait for ever: with each message rospy asks the master whether to add the names of the node's topics,
forgets the answer where nobody has set that parameter, and has no limit. A master that hangs stopped every thread of
every node that said a word: the journal, a planner in the middle of a flight. It is asked once, at the start.

What goes wrong all the time is said of one subject only: the `log..._throttle` count by the line of code that calls
them. Of two topics that are read by the same code and are both damaged, the one that is damaged more often would be the
only one that is ever named. `logerr_seldom` counts by the subject.
"""

from __future__ import annotations

import socket
import threading
import time
import xmlrpc.client
from contextlib import suppress
from typing import Any, Callable, Dict, List
from urllib.parse import urlsplit

import rosgraph
import rospy
import rospy.core
from rospy.impl.registration import RegManager
from rospy.impl.tcpros_base import TCPROSServer, TCPServer

from .asker import note_accepted
from .errors import StartError


def mend_rospy() -> None:
    """Call it before `rospy.init_node`; more than once is the same."""
    TCPROSServer._tcp_server_callback = _accept
    TCPServer.run = _serve
    RegManager.run = _connect
    rospy.core._add_shutdown_hook = _add_hook
    rospy.get_param_cached = _asked_once  # in all of rospy nobody else asks so
    if not hasattr(threading.Thread, "isAlive"):
        threading.Thread.isAlive = threading.Thread.is_alive  # type: ignore[method-assign]


def ask_master() -> None:
    """Call it after `rospy.init_node`: what would be asked in flight is asked now, of a master that is there."""
    with suppress(OSError, xmlrpc.client.Error):
        rospy.get_param_cached("/rosout_disable_topics_generation", False)  # as rospy/impl/rosout.py does


_ask = rospy.get_param_cached
_answers: Dict[str, Any] = {}


def _asked_once(name: str, default: Any = None) -> Any:
    if name not in _answers:
        _answers[name] = _ask(name, default)
    return _answers[name]


_MOST_SILENT, _AGAIN_S, _SAY_AGAIN_S = 100, 0.05, 5.0
_read = TCPROSServer._tcp_server_callback
_silent: Dict[int, socket.socket] = {}  # connections whose header has not come yet, the oldest first
_silent_lock = threading.Lock()


def _accept(server: Any, sock: socket.socket, address: Any) -> None:
    note_accepted(sock)
    with _silent_lock:
        _silent[id(sock)] = sock
        oldest = next(iter(_silent.values())) if len(_silent) > _MOST_SILENT else None
    if oldest is not None:
        with suppress(OSError):
            oldest.shutdown(socket.SHUT_RDWR)  # its thread sees the end of it
    try:
        threading.Thread(target=_read_header, args=(server, sock, address), name="inbound", daemon=True).start()
    except BaseException:
        _forget(sock)
        raise


def _read_header(server: Any, sock: socket.socket, address: Any) -> None:
    try:
        _read(server, sock, address)
    finally:
        _forget(sock)


def _forget(sock: socket.socket) -> None:
    with _silent_lock:
        _silent.pop(id(sock), None)


_connect_publishers = RegManager.run


def _connect(manager: Any) -> None:
    """Connect publishers until the node ends: one that cannot be connected now is not the last one."""
    while not manager.handler.done and not rospy.is_shutdown():
        try:
            _connect_publishers(manager)
        except Exception as error:
            _complain("connect", "a publisher cannot be connected", error)
            time.sleep(_AGAIN_S)


def _serve(server: Any) -> None:
    """Accept connections until the server is shut down: one that cannot be had is not the last one."""
    server.is_shutdown = False
    while not server.is_shutdown:
        try:
            sock, address = server.server_sock.accept()
        except OSError as error:  # a time-out among them
            if not isinstance(error, (socket.timeout, ConnectionAbortedError)) and not server.is_shutdown:
                _complain("accept", "no connection can be accepted", error)
                time.sleep(_AGAIN_S)
            continue
        try:
            server.inbound_handler(sock, address)
        except Exception as error:
            _complain("serve", f"a connection from {address} cannot be served", error)
            sock.close()


_said_s: Dict[str, float] = {}


def logerr_seldom(again_s: float, subject: str, words: str) -> None:
    """Log an error, unless one of the same subject was logged lately; from any thread.

    Args:
        again_s: time in which it is not said again.
        subject: what the words are about, e.g. a topic; one of few, since they are remembered.
        words: the text.
    """
    now_s = time.monotonic()
    last_s = _said_s.get(subject)
    if last_s is None or now_s - last_s >= again_s:
        _said_s[subject] = now_s
        rospy.logerr(words)


def _complain(subject: str, words: str, error: Exception) -> None:
    with suppress(Exception):  # there may be no memory for it: to go on is what counts
        logerr_seldom(_SAY_AGAIN_S, f"{__name__} {subject}", f"{words}: {error!r}")


_add = rospy.core._add_shutdown_hook


def _add_hook(hook: Callable[..., None], hooks: List[Any], pass_reason_argument: bool = True) -> None:  # noqa: FBT001, FBT002
    """Add a hook, or call it when a shutdown held the lock meanwhile: it has called all hooks that it knew."""
    _add(hook, hooks, pass_reason_argument)
    with rospy.core._shutdown_lock:
        late = rospy.core.is_shutdown() and hook in hooks
        if late:
            hooks.remove(hook)
    if late:
        hook(*["already shut down"][: int(pass_reason_argument)])


def check_master_uri() -> None:
    """Look at ROS_MASTER_URI.

    Raises:
        StartError: No master can be reached under it.
    """
    try:
        uri = str(rosgraph.get_master_uri())  # a word __master:=URI is before the environment
    except ValueError as error:
        raise StartError(str(error)) from error
    if not _usable(uri):
        raise StartError(f"ROS_MASTER_URI is {uri!r}; must be http://HOST:PORT")


def _usable(uri: str) -> bool:
    """Return whether an address is one of a host; without a port it is the one of HTTP."""
    try:
        parts = urlsplit(uri)
        host = parts.hostname or ""
        return parts.scheme in ("http", "https") and host.split() == [host] and parts.port != 0
    except ValueError:  # the port is no number
        return False
