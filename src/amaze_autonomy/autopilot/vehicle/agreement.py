"""What several messages of the vehicle agree on: no single one of them ends a flight, or takes it from us. Pure.

A message may be wrong, or somebody else's: one bit, one datagram. What ends our care for a flying vehicle is believed
when messages in a row say it for a time (`flight_end_confirm_s`, `pilot_confirm_s`: rows of the engine's limits), so at
least two of each kind; one that says otherwise begins it anew. A landing waits for none of it. What was said before the
autopilot was started again counts nothing; `PowerOn` notices that.
"""

from __future__ import annotations

from typing import Optional

from amaze_autonomy.engine.events import VehicleLanded

_S = 1_000_000_000
STALL_NS, DRAIN_NS = _S // 2, 3 * _S // 10  # not woken for so long; for so long what came meanwhile is read
READ_NS = 50_000_000  # for so long what came by another socket may lie there, when that of the vehicle is empty
UNREAD_NS = _S  # so long a landing waits for an empty socket: nobody knows what a computer that is so busy will read
KEPT_NS, MODE_NS = _S, 6 * _S // 10  # what so long a time brings, a socket holds; a mode is said once in that time
GROUND_NS = 700_000_000  # three of the stream's periods: older than that, ON_GROUND is no reason to disarm
_RESTART_NS = _S  # the time since it was switched on goes back by more than that only where it was started again
_PACE, _EXCHANGED_NS = 20, 60 * _S  # no simulator's time runs so much faster than ours: it is another autopilot
_GAP_NS = 3 * _S  # after such a silence nobody agrees with what was said before it


class Agreement:
    """Messages of one kind in a row that say the same.

    Args:
        gap_ns: after such a silence none agrees with what was said before it; None: they come seldom, each counts.
    """

    def __init__(self, gap_ns: Optional[int] = _GAP_NS) -> None:
        self._gap_ns = gap_ns
        self.since_ns: Optional[int] = None
        self._until_ns = 0

    def add(self, t_ns: int, *, so: bool) -> None:
        """Take a message: it says so, or otherwise."""
        if not so:
            self.since_ns = None
        elif self.since_ns is None or (self._gap_ns is not None and t_ns - self._until_ns > self._gap_ns):
            self.since_ns = t_ns
        self._until_ns = t_ns

    def lasts(self, limit_ns: int) -> bool:
        """Return whether at least two of them agree over a time."""
        return self.since_ns is not None and self._until_ns - self.since_ns >= max(1, limit_ns)

    def is_fresh(self, t_ns: int, limit_ns: int) -> bool:
        """Return whether the last message, whatever it said, is not older than that."""
        return t_ns - self._until_ns <= limit_ns


class PowerOn:
    """When the autopilot was switched on, by what its messages say; the clock of a simulator may run at another pace.

    Attributes:
        since_ns: when it was; None: no message says it, as behind mavros.
        starts: how often it was seen to have been started again.
    """

    def __init__(self) -> None:
        self.since_ns: Optional[int] = None
        self.starts = 0
        self._on_ns = self._said_ns = 0

    def add(self, t_ns: int, time_boot_ms: int) -> bool:
        """Take for how long a message says that it is on; return whether it was started again. 0 says nothing.

        After a silence it may be on for longer than before it: then it is on for no longer than nothing was heard. One
        that is on for very much longer was plugged in in its place, and nothing of the one before is its own.
        """
        if not time_boot_ms:
            return False
        on_ns = time_boot_ms * 1_000_000
        passed_ns, on_passed_ns = t_ns - self._said_ns, on_ns - self._on_ns
        anew = on_ns <= passed_ns and passed_ns - on_passed_ns > _RESTART_NS
        other = on_passed_ns > _PACE * passed_ns + _EXCHANGED_NS
        again = self.since_ns is not None and (on_passed_ns < -_RESTART_NS or anew or other)
        self.starts += again
        self._on_ns, self._said_ns, self.since_ns = on_ns, t_ns, t_ns - on_ns
        return again


class Ground:
    """Whether the vehicle is disarmed, and stands on the ground.

    Args:
        confirm_ns: so long messages must agree.
    """

    def __init__(self, confirm_ns: int) -> None:
        self._confirm_ns = confirm_ns
        self._armed, self._disarmed, self._on_ground = Agreement(), Agreement(), Agreement()
        self._was_armed = False

    def add_armed(self, t_ns: int, *, armed: bool) -> None:
        """Take a heartbeat."""
        self._armed.add(t_ns, so=armed)
        self._disarmed.add(t_ns, so=not armed)
        self._was_armed = armed or (self._was_armed and not self.disarmed)

    def add_landed(self, t_ns: int, landed: VehicleLanded) -> None:
        """Take a landed state."""
        self._on_ground.add(t_ns, so=landed is VehicleLanded.ON_GROUND)

    @property
    def armed_ns(self) -> Optional[int]:
        """Since when its heartbeats say that it is armed; None: the last one does not."""
        return self._armed.since_ns

    @property
    def disarmed(self) -> bool:
        """True while heartbeats agree on it."""
        return self._disarmed.lasts(self._confirm_ns)

    def stands(self, t_ns: int, limit_ns: int) -> bool:
        """Return whether messages agree that it is on the ground, the last not older than that."""
        return self._on_ground.lasts(self._confirm_ns) and self._on_ground.is_fresh(t_ns, limit_ns)

    def is_down(self, t_ns: int, limit_ns: int) -> bool:
        """Return whether messages agree that it is disarmed and on the ground, the last ones not older than that."""
        return self.disarmed and self._disarmed.is_fresh(t_ns, limit_ns) and self.stands(t_ns, limit_ns)

    def may_fly(self, t_ns: int, limit_ns: int) -> bool:
        """Return whether it was heard armed, and since then messages agree on neither disarmed nor on the ground."""
        return self._was_armed and not self.stands(t_ns, limit_ns)


# --- attention --------------------------------------------------------------------------------------------------------
# A process may stand still: a computer that is too busy, or one that hangs. What lay in its sockets meanwhile is
# stamped as if it came now. So what the process knows of the vehicle is old until the vehicle is heard after all that
# was read: somebody else may fly it. All was read when the socket was seen empty, and no time tells that: a computer
# that is too busy reads slowly. And a socket holds what came first, more than a second of it: what came last found it
# full, and a takeover may have been that. What others have asked of the process lies in its sockets as well.


class Attention:
    """Whether this process has stood still, and what it may send since."""

    def __init__(self) -> None:
        self._looked_ns: Optional[int] = None
        self._woke_ns = self._stood_ns = 0
        self._unread = False  # what came while it stood still, and the socket was not seen empty since
        self._read_ns = self._last_ns = 0  # a landing waits for a mode that is heard after this, until then
        self._may_land = False  # one would have been sent since
        self.awake_ns = 0  # what the vehicle said before this may be older than its stamp

    def look(self, t_ns: int, *, read: bool = False) -> int:
        """Take that the process runs; return for how long it stood still before, 0: it did not.

        Args:
            t_ns: now.
            read: all that had come was read: nothing lies in the socket.
        """
        looked_ns, self._looked_ns = self._looked_ns, t_ns
        stood_ns = 0 if looked_ns is None or t_ns - looked_ns <= STALL_NS else t_ns - looked_ns
        waits = self._unread
        if stood_ns and (self._may_land or (looked_ns or 0) >= self._last_ns):  # else the wait before is not over yet:
            waits = True  # who stands still again and again lands all the same
            self._woke_ns, self._stood_ns, self._may_land = t_ns, stood_ns, False
        if waits:
            self._read_ns = t_ns + READ_NS
            last_ns = self._read_ns if self._stood_ns <= KEPT_NS else t_ns + MODE_NS
            self._last_ns = min(last_ns, self._woke_ns + UNREAD_NS + MODE_NS)
        if stood_ns or self._unread:
            self.awake_ns = t_ns + DRAIN_NS
            self._unread = not read and t_ns < self._woke_ns + UNREAD_NS
        return stood_ns

    def doubts(self, heard_ns: Optional[int]) -> bool:
        """Return whether what was heard then may be over for long: it stood still for longer than a socket holds.

        The socket holds what came first. So what is read last is of any time of the stall, and no newer one came.
        """
        return self._stood_ns > KEPT_NS and (heard_ns or 0) < self.awake_ns

    def lands(self, t_ns: int, heard_ns: Optional[int]) -> bool:
        """Return whether a landing may be sent: what shows who flies has been read, or nothing did in time.

        Args:
            t_ns: now.
            heard_ns: when the mode of the vehicle was heard last.
        """
        waited = not self._unread and (t_ns >= self._last_ns or (heard_ns or 0) >= self._read_ns)
        self._may_land = self._may_land or waited
        return self._may_land

    def streams(self, t_ns: int) -> bool:
        """Return whether set-points may be sent: what came meanwhile has had time to be read; they fly in one mode."""
        return not self._unread and t_ns >= self._read_ns

    def commands(self, heard_ns: Optional[int]) -> bool:
        """Return whether all else may be sent: the mode of the vehicle was heard anew, last at that time."""
        return not self._unread and (heard_ns or 0) >= self.awake_ns
