"""One thread that owns one socket or device: it reads, decodes, tells a client, sends, beats, and opens again.

Other threads ask its client through `Connection.ask` and wait for what becomes of it with `Connection.wait_for`.
"""

from __future__ import annotations

import abc
import contextlib
import functools
import os
import threading
import time
from typing import Any, Callable, Iterable, NamedTuple, Optional, Protocol, Sequence, Tuple, TypeVar

from amaze_autonomy.config.kinds import parse_endpoint

from .dialect import Message, changes_flight, mavlink
from .peers import HEAR_ONE_ALONE, Identity, Peers
from .ports import make_port, wait_readable
from .wire import SigningKey, Stamps, Wire

# --- hosting ----------------------------------------------------------------------------------------------------------
# What every way to the vehicle does for its client: one lock, questions under it, waiting for what comes, errors
# told.
#
# A client is pure: it is given times and messages and returns the messages to send. All of its methods are called
# under the lock of its host, so that other threads may ask it and wait for what becomes of it.


T = TypeVar("T")
_LOOK_NS = 20_000_000


class Client(Protocol):
    """What lives on a link. Both return the messages to send; the link addresses and sequences nothing else."""

    def receive(self, t_ns: int, message: Message, *, heard: bool = True) -> Iterable[Message]:
        """Take a message of the vehicle; not heard: somebody answered in its place, and it may be silent."""

    def wake(self, t_ns: int, *, read: bool = True) -> Iterable[Message]:
        """Look at the time, 20 times a second; all that had come was read, or the link could not be read empty."""


class ClientHost(abc.ABC):
    """Holds a client; who inherits from it sends what `_transmit` is given.

    Args:
        client: what lives on the link.
        now_ns: the clock that stamps what the client is given.
        complain: is told of each new kind of problem.
    """

    def __init__(self, client: Client, now_ns: Callable[[], int], complain: Callable[[str], None]) -> None:
        self._client, self._now_ns, self._complain = client, now_ns, complain
        self._changed = threading.Condition(threading.RLock())
        self._errors, self._complaint = 0, ""
        self._key: Callable[[int], Any] = lambda _t_ns: None
        self._on_change: Callable[[], None] = lambda: None
        self._seen: Any = None
        self._look_ns = 0

    def observe(self, key: Callable[[int], Any], on_change: Callable[[], None]) -> None:
        """Have a change of the client noticed: at once after a question, within 50 ms after anything else.

        Args:
            key: returns what changes, at a time; called under the lock, by any thread.
            on_change: called then; must not wait.
        """
        with self._changed:
            self._key, self._on_change = key, on_change

    def ask(self, question: Callable[[int], Tuple[T, Sequence[Message]]]) -> T:
        """Call a function of the client with the time, under the lock; it returns an answer and messages to send."""
        with self._changed:
            self._catch_up()
            answer, messages = question(self._now_ns())
            self._transmit(messages)
            self._announce(after_ns=0)
            return answer

    def wait_for(self, condition: Callable[[], T], limit_s: float) -> T:
        """Wait until a condition on the client is true; return its last value. It is looked at on each message."""
        with self._changed:
            return self._changed.wait_for(condition, limit_s)

    def _catch_up(self) -> bool:
        """Give the client what has come and was not read yet, where that is known; called under the lock.

        Returns whether nothing lies there any more.
        """
        return True

    @abc.abstractmethod
    def _transmit(self, messages: Iterable[Message]) -> None:
        """Send messages; called under the lock."""

    def _announce(self, after_ns: int = _LOOK_NS) -> None:
        """Wake who waits for something, and see what has changed since the last look, so long ago at least.

        What a vehicle sends comes up to some hundred times a second: to look at each message costs as much as all else.
        """
        self._changed.notify_all()
        monotonic_ns = time.monotonic_ns()
        if monotonic_ns - self._look_ns >= after_ns:
            self._look_ns = monotonic_ns
            self._tell(self._look)

    def _look(self) -> Iterable[Message]:
        key = self._key(self._now_ns())
        if key != self._seen:
            self._seen = key
            self._on_change()
        return ()

    def _tell(self, call: Callable[[], Iterable[Message]]) -> None:
        """Call the client; a defect in it must not cost the heartbeat and all the rest."""
        try:
            self._transmit(call())
        except Exception as error:  # noqa: BLE001 - whatever it is
            self._errors += 1
            self._say(f"{type(error).__name__}: {error}")

    def _say(self, words: str) -> None:
        """Complain, once of the same."""
        if words != self._complaint:
            self._complaint = words
            self._complain(words)


# --- connection -------------------------------------------------------------------------------------------------------


_S = 1_000_000_000
_HEARTBEAT_NS = _S
_REOPEN_NS = _S
_SILENCE_NS = 5 * _S
_WAKE_NS = 50_000_000
_CATCH_UP_NS = 50_000_000
_MAVLINK_VERSION = 3


class LinkState(NamedTuple):
    """How a link is.

    Args:
        opened: the socket or device is open.
        problem: why it is not; empty when it is.
        vehicle: system id of the vehicle, None while it is not known.
        heartbeat_ns: when the vehicle beat last, None: never.
        others: system ids of other vehicles on the link.
        strangers: where others speak from that say our vehicle's system id, or are mixed; None: that cannot be told.
        frames: that were good.
        damaged_bytes: that were in no good frame.
        refused: frames without a good signature.
        unsent: messages that could not be sent.
        doubles: messages from somebody who uses our own address.
        errors: exceptions of the client, and of the link itself.
        mixed: what strangers say cannot be told from what ours says.
    """

    opened: bool
    problem: str
    vehicle: Optional[int]
    heartbeat_ns: Optional[int]
    others: Tuple[int, ...]
    strangers: Optional[Tuple[str, ...]]
    frames: int
    damaged_bytes: int
    refused: int
    unsent: int
    doubles: int
    errors: int
    mixed: bool = False


class Connection(ClientHost):
    """A link to a vehicle.

    Args:
        url: see endpoint.py.
        identity: own address, and the vehicle's.
        client: what lives on it.
        wanted: names of the messages that the client wants; None: all.
        key: for signing; None: unsigned.
        stamps: where the time stamp of signatures is kept; None: in memory.
        kind: MAV_TYPE of the own heartbeat.
        now_ns: the clock that stamps what the client is given.
        complain: is told of each new kind of exception of the client.

    Raises:
        EndpointError: The URL is none.
    """

    def __init__(
        self,
        url: str,
        identity: Identity,
        client: Client,
        *,
        wanted: Optional[Iterable[str]] = None,
        key: Optional[SigningKey] = None,
        stamps: Optional[Stamps] = None,
        kind: int = mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
        now_ns: Callable[[], int] = time.monotonic_ns,
        complain: Callable[[str], None] = lambda _: None,
    ) -> None:
        super().__init__(client, now_ns, complain)
        self._port = make_port(parse_endpoint(url))
        self._wire = Wire(identity.system, identity.component, _with_heartbeat(wanted), key, stamps)
        self._peers, self._kind = Peers(identity), kind
        self._problem, self._unsent = "not opened yet", 0
        self._beat_ns = self._wake_ns = self._open_ns = self._heard_ns = 0  # on the monotonic clock, as all pauses
        self._ended = False
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        self._thread = threading.Thread(target=self._run, name=f"link {url}", daemon=True)

    # --- any thread -----------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Open the link and keep it open."""
        self._thread.start()

    def close(self, limit_s: float = 2.0) -> None:
        """Send what waits, and close."""
        self._ended = True
        self._nudge()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(limit_s)

    def send(self, *messages: Message) -> None:
        """Send messages."""
        with self._changed:
            self._transmit(messages)

    @property
    def address(self) -> Tuple[int, int]:
        """System and component of the vehicle."""
        return self._peers.address

    @property
    def state(self) -> LinkState:
        """How the link is."""
        with self._changed:
            peers, tally, verifier = self._peers, self._wire.tally, self._wire.verifier
            return LinkState(
                opened=not self._problem,
                problem=self._problem,
                vehicle=peers.vehicle,
                heartbeat_ns=peers.heartbeat_ns,
                others=tuple(peers.others),
                strangers=peers.sources.strangers(self._now_ns()),
                frames=tally.good,
                damaged_bytes=tally.damaged_bytes,
                refused=0 if verifier is None else verifier.refused,
                unsent=self._unsent,
                doubles=peers.doubles,
                errors=self._errors,
            )

    # --- the link's own thread ------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._ended:
                try:
                    self._step()
                except Exception as error:  # noqa: BLE001 - whatever it is: a vehicle that flies is not left for it
                    self._begin_anew(f"{type(error).__name__}: {error}")
        finally:
            with self._changed:
                self._drop("closed")
                if self._wire.verifier is not None:
                    self._wire.verifier.close()
                os.close(self._reader)
                os.close(self._writer)

    def _step(self) -> None:
        monotonic_ns = time.monotonic_ns()
        if self._problem and monotonic_ns >= self._open_ns:
            self._open(monotonic_ns)
        with self._changed:
            self._keep(monotonic_ns)
            port, writes = self._port.fileno(), self._port.blocked  # another thread may close it meanwhile
        readable, nudged = wait_readable(
            port, self._reader, (self._next_ns() - time.monotonic_ns()) / _S, writes=writes
        )
        if nudged:
            os.read(self._reader, 4096)
        with self._changed:
            self._attempt(self._port.flush)
            if readable:
                self._attempt(self._read)

    def _begin_anew(self, defect: str) -> None:
        """Say what is wrong in the link itself, and close the port: a moment later it is opened again."""
        with self._changed:
            self._errors += 1
            self._say(defect)
            self._drop(defect)
            self._open_ns = time.monotonic_ns() + _REOPEN_NS
        time.sleep(_WAKE_NS / _S)  # a defect that stays takes no whole core

    def _next_ns(self) -> int:
        return min(self._beat_ns, self._wake_ns, self._open_ns if self._problem else self._wake_ns)

    def _open(self, t_ns: int) -> None:
        """Open the port, without the lock: looking up a name takes its time."""
        self._open_ns = t_ns + _REOPEN_NS
        try:
            self._port.open()
        except OSError as error:
            self._problem = error.strerror or str(error)
            return
        self._heard_ns = self._beat_ns = t_ns
        self._problem = ""

    def _keep(self, t_ns: int) -> None:
        """Do what is due: the heartbeat, the client's look at the time, a link that has fallen silent."""
        if not self._port.silence_is_loss:
            self._heard_ns = t_ns  # nobody is there who could be silent
        if t_ns >= self._beat_ns:
            self._beat_ns = t_ns + _HEARTBEAT_NS
            self._transmit((heartbeat(self._kind),))
        if t_ns >= self._wake_ns:
            self._wake_ns = t_ns + _WAKE_NS
            read = self._catch_up()
            self._tell(lambda: self._client.wake(self._now_ns(), read=read))
            self._announce()
        if self._port.silence_is_loss and not self._problem and t_ns - self._heard_ns > _SILENCE_NS:
            self._drop(f"silent for {_SILENCE_NS // _S} s")

    def _catch_up(self) -> bool:
        """Read what lies in the port: who stood still hears the vehicle before he commands it, or is asked about it."""
        end_ns = time.monotonic_ns() + _CATCH_UP_NS
        while not self._problem and self._attempt(self._read):
            if time.monotonic_ns() >= end_ns:
                return False
        return True

    def _read(self) -> bool:
        """Read once; return whether something has come."""
        unix_ns, t_ns = time.time_ns(), self._now_ns()
        chunks = self._port.read()
        if chunks:
            self._heard_ns = time.monotonic_ns()
        for source, data, waited_ns in chunks:
            came_ns = t_ns - waited_ns
            for frame, message in self._wire.each(data, source, unix_ns):
                if message is None and (frame.signed or self._wire.verifier is None):
                    self._peers.pass_over(came_ns, (frame.system, frame.component), frame.sequence, source)
                elif message is not None and self._peers.take(came_ns, message, source):
                    self._port.prefer(source)
                    self._deliver(t_ns, message)
        self._announce()
        return bool(chunks)

    def _deliver(self, t_ns: int, message: Message) -> None:
        self._tell(lambda: self._client.receive(t_ns, message))

    def _transmit(self, messages: Iterable[Message]) -> None:
        for message in messages:
            data = self._wire.send(message, time.time_ns())
            write = functools.partial(self._port.write, data, flies=changes_flight(message))
            self._unsent += bool(self._problem) or not self._attempt(write)
        if self._port.blocked:
            self._nudge()

    def _attempt(self, what: Callable[[], Any]) -> Any:
        """Do something with the port; close it when that fails."""
        try:
            return what()
        except OSError as error:
            self._drop(error.strerror or str(error))
            return False

    def _drop(self, problem: str) -> None:
        if not self._ended:
            with contextlib.suppress(OSError):
                self._port.discard()  # nobody knows when it would come
        with contextlib.suppress(OSError):
            self._port.close()
        self._wire.forget()
        self._peers.sources.forget()
        self._problem = problem

    def _nudge(self) -> None:
        with contextlib.suppress(OSError):
            os.write(self._writer, b"\0")


def heartbeat(kind: int) -> Message:
    """Return a heartbeat of a companion computer or, by its kind, of something else that is no autopilot."""
    return mavlink.MAVLink_heartbeat_message(
        kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, _MAVLINK_VERSION
    )


def _with_heartbeat(wanted: Optional[Iterable[str]]) -> Optional[Iterable[str]]:
    return None if wanted is None else (*wanted, "HEARTBEAT")


# --- diagnosis --------------------------------------------------------------------------------------------------------
# What is wrong with a link, in words for whoever has to put it right. Pure; the first row that fits counts.


_NOISE_BYTES = 1000
_DOUBLES = 3


def _strangers_problem(state: LinkState) -> str:
    """Return what is wrong with a second vehicle, which is not listened to where it can be told from ours."""
    where = ", ".join(state.strangers or ())
    if state.mixed:
        return f"another vehicle is heard ({where}), and it is taken for ours: {HEAR_ONE_ALONE}"
    words = "it is ignored: give it another MAV_SYS_ID or port"
    return f"another vehicle says system id {state.vehicle}, from {where}; {words}"


def _vehicle(state: LinkState) -> str:
    return "the vehicle" if state.vehicle is None else f"vehicle {state.vehicle}"


def _never(state: LinkState) -> bool:
    return state.heartbeat_ns is None


def _is_silent(state: LinkState, t_ns: int) -> bool:
    return state.heartbeat_ns is not None and t_ns - state.heartbeat_ns > _SILENCE_NS


_Row = Tuple[Callable[[LinkState, int], bool], Callable[[LinkState], str]]
_ROWS: Tuple[_Row, ...] = (
    (lambda state, _: bool(state.problem), lambda state: state.problem),
    (
        lambda state, _: _never(state) and state.refused > 0,
        lambda _: "no message has a good signature: the vehicle has another key, or none",
    ),
    (
        lambda state, _: _never(state) and bool(state.others),
        lambda state: f"no vehicle {state.vehicle}; heard are {', '.join(map(str, state.others))}: see vehicle_id",
    ),
    (
        lambda state, _: _never(state) and state.frames == 0 and state.damaged_bytes > _NOISE_BYTES,
        lambda _: "only noise is heard: is the baud rate right, does MAVLink come from there?",
    ),
    (lambda state, _: _never(state), lambda _: "no vehicle heard yet"),
    (lambda state, _: bool(state.strangers), _strangers_problem),
    (
        _is_silent,  # the words stay the same while it lasts, since each change is told
        lambda state: f"{_vehicle(state)} has fallen silent: no heartbeat for {_SILENCE_NS // _S} s",
    ),
    (
        lambda state, _: state.doubles >= _DOUBLES,
        lambda _: "somebody else speaks with our own system and component id: give one another component_id",
    ),
    (lambda state, _: state.errors > 0, lambda _: "a message could not be dealt with: see the log"),
)


def link_problem(state: LinkState, t_ns: int) -> str:
    """Return what is wrong at a time, of the clock that stamps what the client is given; empty: nothing."""
    return next((words(state) for fits, words in _ROWS if fits(state, t_ns)), "")
