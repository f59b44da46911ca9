"""The real link: the engine's topic and services over ROS. The only module of the console that knows ROS."""

from __future__ import annotations

import logging
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Tuple

import rosgraph
import rospy

from amaze_autonomy.console.link import (
    AnswerCame,
    Arrivals,
    CollectingCame,
    Happening,
    Link,
    LinkClosed,
    LinkSays,
    MessagesCame,
    MissionsCame,
    MissionWanted,
    StateCame,
)
from amaze_autonomy.console.model import DEFAULT_ENGINE, STALE_AFTER_S, Request, RequestKind, Verdict
from amaze_autonomy.console.wire import collecting_of, missions_of, notes_of, snapshot_of, verdict_of
from amaze_autonomy.engine.events import SAFE
from amaze_autonomy.msg import AutonomyState, OperatorMessages, RecordingStatus
from amaze_autonomy.ros.errors import CallError, CallTimeoutError, NodeError, StartError
from amaze_autonomy.ros.reconnector import Reconnector
from amaze_autonomy.ros.rospy_flaws import check_master_uri, mend_rospy
from amaze_autonomy.ros.service_client import ServiceClient
from amaze_autonomy.srv import ListMissions, SelectMission, UserCommand

from .wire import clean

_LOOK_S, _CONNECT_S, _ANSWER_S = 1.0, 0.5, 10.0
_TAKEN_BACK = "; it may have been carried out; if not by now, it is not any more"
_SERVICES = {"list_missions": ListMissions, "select_mission": SelectMission, "command": UserCommand}


class RosLink(Link):
    """A console's connection to the engine: `<engine>`, which is `autonomy` unless told otherwise.

    Subscribes: `<engine>/state` (AutonomyState, latched, 2 Hz and at each decision); `<engine>/messages`
    (OperatorMessages, latched); `data_recorder/status` (RecordingStatus, 2 Hz) in the engine's name space, for the time
    that a phase still takes and the recording on each platform.
    Calls: `<engine>/list_missions` (ListMissions), `<engine>/select_mission` (SelectMission), `<engine>/command`
    (UserCommand). Each call has its own thread: one that hangs delays no other. Connections stay open: a command needs
    no ROS master. What moves the vehicle is taken back when it was not answered in time, or when this process ends.
    Parameters: `~engine` (string), `~mission` (string, number or a list of them), where the command line says nothing.

    A master or an engine that is not there yet, goes away or comes back is waited for and found again.

    Args:
        post: takes what happens; called from several threads.
        engine: its name; None: the parameter, or `autonomy` in its own name space.
        quiet: ROS prints nothing: the screen is in use.
    """

    def __init__(self, post: Callable[[Happening], None], engine: Optional[str], *, quiet: bool) -> None:
        self._post, self._engine, self._quiet = post, engine, quiet
        self._heard_s = 0.0
        self._states, self._recordings = Arrivals(), Arrivals()
        self._closed = threading.Event()
        self._subscribers: List[rospy.Subscriber] = []
        self._services: Dict[str, ServiceClient] = {}
        self._reconnector: Optional[Reconnector] = None

    def start(self) -> None:
        """Connect in the background."""
        threading.Thread(target=self._run, name="link", daemon=True).start()

    def send(self, request: Request) -> None:
        """Call the service in a thread of its own; its answer, or why there is none, is posted."""
        threading.Thread(target=self._call, args=(request,), name=request.words, daemon=True).start()

    def close(self) -> None:
        """Tell the master, if it can be told within a second, that this console is gone."""
        self._closed.set()
        if self._reconnector is not None:
            self._reconnector.stop()
        if rospy.core.is_initialized():
            goodbye = threading.Thread(target=rospy.signal_shutdown, args=("console closed",), daemon=True)
            goodbye.start()
            goodbye.join(1.0)

    # --- in the background ---

    def _run(self) -> None:
        try:
            check_master_uri()
            self._wait_for_master()
            if self._closed.is_set():
                return
            self._connect()
        except (StartError, rospy.ROSException, OSError, ValueError) as error:
            self._post(LinkClosed(f"No connection to ROS: {clean(str(error))}.", failed=True))
            return
        while not self._closed.wait(_LOOK_S):
            self._repair()
            for service in self._services.values():
                service.keep(_CONNECT_S)

    def _connect(self) -> None:
        # rospy alone would take over the signals and wait for the master without an end.
        mend_rospy()
        rospy.init_node("console", anonymous=True, disable_signals=True, disable_rosout=True)
        if self._quiet:
            _silence()
        rospy.on_shutdown(lambda: self._post(LinkClosed("ROS shut this console down.")))
        engine = self._engine or str(rospy.get_param("~engine", "") or DEFAULT_ENGINE)
        if not rosgraph.names.is_legal_name(engine):
            raise ValueError(f'"{engine}" cannot be the name of a node, e.g. /{DEFAULT_ENGINE}')
        self._engine = engine = str(rospy.resolve_name(engine.rstrip("/")))
        self._post(LinkSays("", engine=clean(engine, 80)))
        missions = _names(rospy.get_param("~mission", ""))
        if missions:
            self._post(MissionWanted(missions))
        master, me = rosgraph.get_master_uri(), rospy.get_name()
        self._services = {
            name: ServiceClient(rospy.resolve_name(f"{engine}/{name}"), kind, master, me)
            for name, kind in _SERVICES.items()
        }
        self._subscribe()
        self._reconnector = Reconnector()  # the master says once, perhaps to nobody, that there is an engine
        self._reconnector.start()

    def _wait_for_master(self) -> None:
        while not self._closed.is_set() and not rosgraph.is_master_online():
            uri = clean(rosgraph.get_master_uri(), 80)
            self._post(LinkSays(f"Waiting for the ROS master at {uri}"))
            self._closed.wait(_LOOK_S)

    def _subscribe(self) -> None:
        for each in self._subscribers:
            each.unregister()
        recorder = f"{rosgraph.names.namespace(self._engine)}data_recorder/status"
        self._subscribers = [
            rospy.Subscriber(f"{self._engine}/state", AutonomyState, self._on_state, queue_size=10),
            rospy.Subscriber(f"{self._engine}/messages", OperatorMessages, self._on_messages, queue_size=1),
            rospy.Subscriber(recorder, RecordingStatus, self._on_recording, queue_size=1),
        ]

    def _on_state(self, message: AutonomyState) -> None:
        self._heard_s = time.monotonic()
        self._post(StateCame(snapshot_of(message), _age_s(self._states, message)))

    def _on_messages(self, message: OperatorMessages) -> None:
        self._post(MessagesCame(*notes_of(message)))

    def _on_recording(self, message: RecordingStatus) -> None:
        self._post(CollectingCame(collecting_of(message), _age_s(self._recordings, message)))

    def _repair(self) -> None:
        """Subscribe anew when the engine is silent because the master was started anew and has forgotten us."""
        if time.monotonic() - self._heard_s <= STALE_AFTER_S:
            return
        try:
            if not _is_known():
                self._subscribe()
        except (rospy.ROSException, OSError):  # there is no master at present
            return

    def _call(self, request: Request) -> None:
        try:
            self._post(self._answer(request))
        except (NodeError, ValueError) as error:  # the latter: an id that is no UTF-8
            self._post(AnswerCame(request.id, Verdict.NO_ANSWER, clean(str(error))))

    def _answer(self, request: Request) -> Happening:
        if request.kind is RequestKind.LIST:
            return MissionsCame(request.id, missions_of(self._ask("list_missions")))
        if request.kind is RequestKind.SELECT:
            reply = self._ask("select_mission", expires=True, mission_ids=list(request.missions))
            verdict = Verdict.DONE if reply.accepted else Verdict.REFUSED
            return AnswerCame(request.id, verdict, clean(reply.message))
        command = "" if request.command is None else request.command.value
        reply = self._ask("command", expires=request.command not in SAFE, command=command)
        return AnswerCame(request.id, verdict_of(reply.answer), clean(reply.message))

    def _ask(self, name: str, *, expires: bool = False, **fields: Any) -> Any:
        """Call a service of the engine.

        Args:
            name: of the service.
            expires: nobody may be surprised by it after he was told that there is no answer.
            fields: of the request.

        Raises:
            NodeError: There is no answer; the text says why.
        """
        service = self._services.get(name)
        if service is None:
            raise NodeError("not connected yet")
        try:
            return service.ask(_ANSWER_S, expires=expires, **fields)
        except CallTimeoutError as error:
            raise NodeError(f"{service.name}: {error}{_TAKEN_BACK if expires else ''}") from error
        except CallError as error:
            raise NodeError(f"{service.name}: {error}") from error


def _is_known() -> bool:
    """Return True when the master knows this node."""
    try:
        rosgraph.Master(rospy.get_name()).lookupNode(rospy.get_name())
    except rosgraph.MasterError:
        return False
    return True


def _age_s(arrivals: Arrivals, message: Any) -> float:
    """Return how old a message is; simulated time may stand, or be faster than we are: then nothing is known of it."""
    if not rospy.rostime.is_wallclock():
        return 0.0
    return arrivals.age_s(message.header.stamp.to_sec(), time.monotonic())


def _names(parameter: Any) -> Tuple[str, ...]:
    """Return the ids that a parameter names: "1", 1, "1 2" or [1, 2]."""
    words: List[Any] = parameter if isinstance(parameter, list) else [parameter]
    return tuple(name for word in words for name in clean(str(word)).replace(",", " ").split())


def _silence() -> None:
    """Take ROS's printing handlers away; its log file stays."""
    for name in ("", "rosout", "rospy"):
        logger = logging.getLogger(name)
        for handler in list(logger.handlers):
            if not isinstance(handler, logging.FileHandler):
                logger.removeHandler(handler)
