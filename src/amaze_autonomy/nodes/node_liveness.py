"""Does a node live? Asked of the node itself (XML-RPC getPid, http://wiki.ros.org/ROS/Slave_API).

The master only says where a node was when it registered; one that was killed stays on its list. So the master is asked
for the address alone, and again whenever nobody answers there: a node that was restarted has another one.
"""

from __future__ import annotations

from typing import NamedTuple, Optional

from .errors import BrokenCallError, CallError, CallTimeoutError, UnavailableError
from .xmlrpc_call import call

__all__ = ["Answer", "NodeLiveness", "Place"]


class Answer(NamedTuple):
    """What came of asking.

    Args:
        alive: True: it answered; False: nobody is where it was; None: no answer in time, or it has not come up yet.
        message: why not.
    """

    alive: Optional[bool]
    message: str = ""


class Place(NamedTuple):
    """Where a node answered last.

    Args:
        uri: of its API.
        pid: as it said itself, on its own computer.
    """

    uri: str
    pid: int


class NodeLiveness:
    """One node; used by one thread at a time, except `place`.

    Args:
        node: its resolved name.
        master_uri: of the ROS master.
        caller_id: name of the node that asks.
        limit_s: time for each question, to the node and to the master.
    """

    def __init__(self, node: str, master_uri: str, caller_id: str, limit_s: float) -> None:
        self.node = node
        self.place: Optional[Place] = None
        self._master_uri, self._caller_id, self._limit_s = master_uri, caller_id, limit_s

    def ask(self) -> Answer:
        """Ask where it answered last, and where the master says it is when nobody answers there."""
        known = self.place
        if known is None:
            return self._ask_anew("")
        try:
            pid = self._pid(known.uri)
        except (UnavailableError, BrokenCallError) as error:
            return self._ask_anew(str(error))
        except CallTimeoutError as error:
            moved = self._look_up()
            return Answer(None, str(error)) if moved in (None, known.uri) else self._ask_anew(str(error))
        if pid != known.pid:  # somebody else may have got its port
            return self._ask_anew(f"process {known.pid} is gone")
        return Answer(alive=True)

    def _ask_anew(self, problem: str) -> Answer:
        """Ask where the master says it is; what never answered may still be coming up."""
        uri = self._look_up()
        silent = None if self.place is None else False
        if uri is None:
            return Answer(silent, problem or "not registered at the master")
        try:
            self.place = Place(uri, self._pid(uri))
        except CallTimeoutError as error:
            return Answer(None, str(error))
        except CallError as error:
            return Answer(silent, str(error))
        return Answer(alive=True)

    def _pid(self, uri: str) -> int:
        return int(call(uri, "getPid", (self._caller_id,), self._limit_s))

    def _look_up(self) -> Optional[str]:
        """Return the address that the master knows; None when it knows none, or does not answer."""
        try:
            return str(call(self._master_uri, "lookupNode", (self._caller_id, self.node), self._limit_s))
        except CallError:
            return None
