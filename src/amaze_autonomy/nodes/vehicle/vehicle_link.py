"""The way to the vehicle that the configuration asks for: a `Connection` over MAVLink, or mavros."""

from __future__ import annotations

import threading
from queue import Empty, SimpleQueue
from typing import Any, Callable, Iterable, Protocol, Sequence, Tuple, TypeVar

import rospy

from amaze_autonomy.autopilot import AutopilotError, Client, Connection, Identity, LinkState, read_key
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.config.errors import EndpointError
from amaze_autonomy.config.schemas.autopilot import LinkSettings
from amaze_autonomy.paths import expanded
from amaze_autonomy.ros.clock import Clock

from ...autopilot.link.dialect import Message, mavlink
from ...autopilot.link.state_files import StampFile
from ...ros.errors import StartError

T = TypeVar("T")


class Link(Protocol):
    """What a node needs of a link: a `Connection`, or mavros."""

    def start(self) -> None:
        """Open it and keep it open."""

    def close(self) -> None:
        """Close it."""

    def observe(self, key: Callable[[int], Any], on_change: Callable[[], None]) -> None:
        """Call a function soon after what a key of the client says has changed."""

    def ask(self, question: Callable[[int], Tuple[T, Sequence[Message]]]) -> T:
        """Call a function of the client under the link's lock, send what it returns."""

    def wait_for(self, condition: Callable[[], T], limit_s: float) -> T:
        """Wait until a condition on the client is true."""

    @property
    def address(self) -> Tuple[int, int]:
        """System and component of the vehicle."""

    @property
    def state(self) -> LinkState:
        """How it is."""


class ChangeLog:
    """Logs what is answered, once for each change: who asks twice a second for the length of a cut fills no log."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._said: Tuple[str, str] = ("", "")

    def log(self, what: str, answer: str, *, warns: bool) -> None:
        """Log the answer to a question, as a warning or not, unless both are the last ones; from any thread."""
        with self._lock:
            again, self._said = self._said == (what, answer), (what, answer)
        if not again:
            (rospy.logwarn if warns else rospy.loginfo)("%s: %s", what, answer)


def tell_link(whose: str, settings: AutopilotSettings, link: LinkSettings, problem: str) -> None:
    """Log what has become of a link, with its owner, since both nodes log into one terminal."""
    way = f"through mavros at {settings.mavros}" if settings.backend == "mavros" else link.url
    (rospy.logwarn if problem else rospy.loginfo)("%s's link, %s: %s", whose, way, problem or "up")


def make_link(
    settings: AutopilotSettings, link: LinkSettings, client: Client, wanted: Iterable[str], clock: Clock
) -> Link:
    """Return the link that the configuration asks for.

    A landing needs time that passes: where /clock stands (`use_sim_time`), the clock goes on by itself from its limit
    on, or what was lost on the way would not be sent again.

    Args:
        settings: which backend, and of mavros.
        link: of this node, for MAVLink.
        client: what lives on it.
        wanted: names of the messages that the client wants.
        clock: of the node.

    Raises:
        StartError: it cannot be.
    """
    clock.goes_on = True
    try:
        if settings.backend == "mavros":
            from .mavros_link import MavrosLink  # noqa: PLC0415 - mavros_msgs is needed by nobody else

            return MavrosLink(settings.mavros, client, wanted, clock.now_ns, rospy.logerr)
        key_file = expanded(link.key_file) if link.key_file else None
        stamps = key_file.with_name(f"{key_file.name}.{link.component_id}.stamp") if key_file else None
        return Connection(
            link.url,
            Identity(link.system_id, link.component_id, link.vehicle_id),
            client,
            wanted=wanted,
            key=read_key(key_file) if key_file else None,
            stamps=StampFile(stamps) if stamps else None,
            kind=mavlink.MAV_TYPE_GCS if link.ground_station else mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
            now_ns=clock.now_ns,
            complain=rospy.logerr,
        )
    except (AutopilotError, EndpointError) as error:
        raise StartError(str(error)) from None


# --- level loop -------------------------------------------------------------------------------------------------------
# Tells a level at its rate, and at once when it changes: the loop of the autopilot node and of the planner.


class LevelLoop:
    """Tells a level: at its rate, and when it changes.

    Args:
        link: on which changes come.
        clock: of the node.
        period_ns: between two that change nothing.
        key: returns what is told soon when it changes, at a time; called under the link's lock.
        tell: tells it.
    """

    def __init__(
        self, link: Link, clock: Clock, period_ns: int, key: Callable[[int], Any], tell: Callable[[int], None]
    ) -> None:
        self._clock, self._period_ns, self._tell = clock, period_ns, tell
        self._news: SimpleQueue[None] = SimpleQueue()  # its `put` may be called by a signal handler
        self.ended = False
        link.observe(key, self._wake)

    def run(self) -> None:
        """Tell until `end`."""
        due_ns = self._clock.now_ns()
        while not self.ended:
            changed, now_ns = self._wait(due_ns), self._clock.now_ns()
            if changed or now_ns >= due_ns:
                due_ns = now_ns + self._period_ns
                self._tell(now_ns)

    def _wait(self, due_ns: int) -> bool:
        """Wait until something has changed, at most until it is due; return whether it has."""
        try:
            self._news.get(timeout=self._clock.wall_wait_s(due_ns))
        except Empty:
            return False
        return True

    def _wake(self) -> None:
        if self._news.empty():
            self._news.put(None)

    def end(self) -> None:
        """End; from any thread."""
        self.ended = True
        self._wake()
