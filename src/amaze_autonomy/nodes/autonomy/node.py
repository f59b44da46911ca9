"""The autonomy node: wires the engine to ROS. It decides nothing itself.

Services it calls, topics it listens to: `interface.py`. It offers, in its private namespace:

    ~state           AutonomyState, latched, at each decision and 2 Hz
    ~messages        OperatorMessages, latched: the last messages to the user, numbered
    ~journal         JournalEntry, every line of the journal; a new listener first gets all lines so far
    /diagnostics     diagnostic_msgs/DiagnosticArray, 1 Hz
    ~list_missions   ListMissions
    ~select_mission  SelectMission
    ~command         UserCommand, by its name
    ~go ~retry ~give_up ~hold ~resume ~land ~abort ~acknowledge   std_srvs/Trigger, the same

Parameters: `node_main.py`. Exit status: the results at the end.
"""

from __future__ import annotations

import faulthandler
import logging
import os
import sys
import threading
import time
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Set, Tuple

import rosgraph
import rospy
from std_msgs.msg import Bool

from amaze_autonomy.config import ConfigError, Configuration, load_configuration
from amaze_autonomy.engine.commands import Command
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import (
    EngineStarted,
    Event,
    MissionRejected,
    Shutdown,
    UserRequest,
)
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import DataResult, EngineState, Result
from amaze_autonomy.engine.timers import next_deadline
from amaze_autonomy.interface import STATUSES, Status
from amaze_autonomy.monitoring.land_switch import LandRequests
from amaze_autonomy.ros.clock import Clock, make_clock, wait_for_time

from ...interface.fields import MOST_ITEMS
from ...journal import journal as codec
from ...journal.report import MessageLog, end_on_the_way
from ...ros import node_main
from ...ros.arguments import answer_words
from ...ros.errors import NodeError, StartError, report
from ...ros.interface import SERVICE_CLASSES, message_class
from ...ros.node_main import Parameters, read_parameters
from ...ros.reconnector import Reconnector
from ...ros.service_client import ServiceClient
from ...ros.topic_reader import ALL, Tally, subscribe
from . import run_folder
from .ending import (
    ENGINE_ENDED,
    NOTHING_UNDER_WAY,
    Ended,
    Ending,
    Farewell,
    Pulse,
    first_reason,
    said_of_data,
    start_anew,
)
from .engine_thread import EngineThread, Inbox, Stall
from .journal_file import InUseError, JournalFile, create
from .outbox import Diagnostics, Outbox, PeerClocks, StatePublisher, Timeline
from .requests import Requests
from .run_folder import BOOT_CLOCK, ROS_CLOCK, Place
from .users import Unattended, UserDesk, choose, not_selected

_log = logging.getLogger(__name__)
_FAREWELL_LIMIT_S = 5.0
_LAST_LANDING_LIMIT_S = 1.0  # the process that follows asks again
_HAND_OVER_LIMIT_S = 10.0
_STDERR = 2  # `sys.stderr` may be anything
_MASTER_LIMIT_S = 1.0
_LOOK_AGAIN_S = 0.2
_LONGEST_STATUS = 1 << 22  # bytes
_SAY_AGAIN_S = 10.0
_LAST_WORDS_S = 0.3  # until what was published last is on the wire
_LITTLE_MEMORY = 2e9
_SPARE = {"mission_planner/command": 2}  # connections that stay open; of all others one: in flight no master is needed


class AutonomyNode:
    """All parts of the node, and how they are connected.

    Args:
        parameters: of the node.
        configuration: as loaded.
        clock: that decides.
        label: prefix of session ids, made from the wall time.
        unfinished: the journal to go on with.
    """

    def __init__(
        self,
        parameters: Parameters,
        configuration: Configuration,
        clock: Clock,
        label: str,
        unfinished: Optional[run_folder.Unfinished] = None,
    ) -> None:
        self._parameters, self._configuration, self._clock = parameters, configuration, clock
        self._label, self._resumed = label, unfinished
        self._selected = unfinished is not None and unfinished.selected
        self._place = _place(parameters)
        self._reasons: SimpleQueue[str] = SimpleQueue()
        self._rejected: Dict[str, int] = {}
        self._left_out: Dict[str, int] = {}
        self._warned: Set[Tuple[str, str]] = set()
        self._timeline = Timeline()
        self._farewell = Farewell()
        self._journal = self._open_journal()
        messages = MessageLog()
        self._ending = Ending(self._reasons.put, configuration.rules, exit_when_ended=parameters.exit_when_ended)
        events = unfinished.events if unfinished is not None else []
        state = decided_again(events, configuration.rules, messages, self._ending, self._timeline)
        self._unattended = Unattended(configuration.rules) if parameters.unattended else None
        self._switch = LandRequests(configuration.without_land_switch)
        self._reconnector = Reconnector()
        least_free = configuration.recording.storage.min_free_fraction
        self._state_publisher = StatePublisher(
            configuration.rules, clock, self._remarks, self._run_label(), messages, least_free
        )
        self._outbox = Outbox(
            self._journal,
            self._timeline,
            clock,
            self._state_publisher.publish,
            self._state_publisher.say,
            self._housekeeping,
            self._name_journal,
            partial(end_on_the_way, rules=configuration.rules),
        )
        self._requests = Requests(self._clients(), self.put, clock.now_ns)
        self._desk = UserDesk(configuration.missions, self.put, clock.now_ns, configuration.battery.minimum_fraction)
        self._inbox = Inbox(clock, self._reject, self._stalled, shortened=self._shorten)
        self._engine = EngineThread(
            decide,
            next_deadline,
            configuration.rules,
            clock,
            self._inbox,
            self._requests.send,
            self._desk.answer,
            self._record,
            state,
            self._outbox.wait,
            self._desk.take_up,
        )
        self._clocks = PeerClocks(configuration.rules.limits)
        self._diagnostics = Diagnostics(
            lambda: self._engine.state,
            self._journal,
            self._rejected,
            self._left_out,
            lambda: len(self._requests.open),
            self._clocks,
            self._foreign,
        )

    # --- start ----------------------------------------------------------------------------------------------------

    def _clients(self) -> Dict[str, ServiceClient]:
        master, me = rosgraph.get_master_uri(), rospy.get_name()
        return {
            name: ServiceClient(rospy.resolve_name(name), service, master, me, _SPARE.get(name, 1))
            for name, service in SERVICE_CLASSES.items()
        }

    def _open_journal(self) -> JournalFile:
        if self._resumed is not None:
            return self._resumed.journal
        header = codec.make_header(
            self._configuration.rules,
            self._configuration.effective,
            self._configuration.hash,
            boot_id=run_folder.boot_id(),
            clock=_clock_name(),
            label=self._label,
            **self._place.facts(),
            python=sys.version.split()[0],
            started=datetime.now(timezone.utc).isoformat(timespec="seconds"),
            written_by="autonomy node",
        )
        folder = run_folder.make_folder(self._place, self._label)
        return create(folder, codec.encode_header(header), self._place.elsewhere)

    def _run_label(self) -> str:
        """Return the name of the run whose messages go on: that of the journal."""
        return self._label if self._resumed is None else str(self._resumed.header.get("label", self._label))

    def start(self) -> None:
        """Begin to decide, then open the node to the world."""
        self._name_journal()
        if self._parameters.missions and self._selected:
            rospy.logwarn(not_selected(self._engine.state, self._parameters.missions))
        self._outbox.start(self._engine.state)
        resumed = self._resumed is not None
        away_ns = self._resumed.away_ns if self._resumed is not None else 0
        self.put(EngineStarted(t_ns=self._clock.now_ns(), label=self._label, resumed=resumed, away_ns=away_ns))
        self._engine.start()
        self._desk.open()
        for status in STATUSES:
            self._listen(status)
        rospy.Subscriber("autopilot/land_switch", Bool, self._take_switch, queue_size=1, tcp_nodelay=True)
        self._reconnector.start()
        if self._parameters.missions and not self._selected:
            threading.Thread(target=self._select, name="select", daemon=True).start()
        node_main.settle()

    def _name_journal(self) -> None:
        """Say where the journal is: the recorder copies it into the recording."""
        try:
            run_folder.register(self._run_label(), self._journal.path, also=self._label)
        except OSError as error:
            rospy.logwarn("the recorder will not find the journal: %s", error)

    def _select(self) -> None:
        """Select the missions of the parameter once all peers are there, or have had the time to come."""
        deadline_s = time.monotonic() + self._parameters.peers_limit_s
        while time.monotonic() < deadline_s and self._requests.missing(_MASTER_LIMIT_S):
            time.sleep(_LOOK_AGAIN_S)
        self.put(choose(self._configuration.missions, self._parameters.missions, self._clock.now_ns()))

    def _listen(self, status: Status) -> None:
        """Have the engine's thread read a status."""
        name = rospy.resolve_name(status.topic)
        tally = Tally(name, ALL, _LONGEST_STATUS)
        subscribe(name, self._inbox.reader, tally, self._inbox.look_for(status), message_class(status))

    def _foreign(self) -> Tuple[str, ...]:
        """Return a line for each publisher of another type on a topic of ours."""
        return tuple(map(str, self._reconnector.foreign))

    def _remarks(self) -> Tuple[str, ...]:
        """Return what the node itself has to say to the operator: not what the engine decided."""
        return (*self._foreign(), *self._journal.remarks)

    def _reject(self, topic: str, error: Any) -> None:
        """Count an invalid message; warn once per topic and field."""
        self._rejected[topic] = self._rejected.get(topic, 0) + 1
        if (topic, error.field) not in self._warned:
            self._warned.add((topic, error.field))
            text = f"{rospy.resolve_name(topic)}: invalid message ignored: {error} (logged once)"
            self._outbox.log(partial(rospy.logwarn, text))

    def _shorten(self, topic: str, name: str, count: int) -> None:
        """Count what is left out of too long a list; warn once per list."""
        row = f"{topic} {name}"
        self._left_out[row] = self._left_out.get(row, 0) + count
        if (topic, name) not in self._warned:
            self._warned.add((topic, name))
            text = f"{rospy.resolve_name(topic)}: too many {name}: {count} left out, {MOST_ITEMS} kept (logged once)"
            self._outbox.log(partial(rospy.logwarn, text))

    def _stalled(self, stall: Stall) -> None:
        text = f"The engine did not run for {stall.duration_s:.3f} s; {stall.read} statuses had come meanwhile"
        left_out = f", {stall.left_out} of them were passed over for later ones" if stall.left_out else ""
        self._outbox.log(partial(rospy.logwarn_throttle, _SAY_AGAIN_S, text + left_out))

    # --- run ------------------------------------------------------------------------------------------------------

    def _take_switch(self, message: Any) -> None:
        """Take the switch of the transmitter; a user's request to land, without anybody who waits for an answer."""
        t_ns = self._clock.now_ns()
        request = self._switch.answer(self._engine.state, t_ns, on=message.data)
        if request is not None:
            rospy.logwarn("the switch of the transmitter says land")
            self.put(request)

    def put(self, event: Event) -> None:
        """Give the engine an event; from any thread."""
        self._inbox.put(event)

    def _record(self, event: Event, state: EngineState, commands: Tuple[Command, ...]) -> None:
        """Hand on a step of the engine; on its thread, after the requests went out, or before a takeoff does."""
        self._clock.goes_on = state.flight.active  # a landing that is under way needs time that passes
        self._outbox.put(event, state, commands)
        self._clocks.see(event)
        self._state_publisher.see(event)
        self._farewell.see(event, commands, state)
        self._ending.see(event, state)
        if self._unattended is not None:
            command = self._unattended.answer(state)
            if command is not None:
                self.put(UserRequest(t_ns=state.t_ns, command=command))

    def _housekeeping(self) -> None:
        self._timeline.note_once(self._clock.now_ns(), self._remarks())
        self._diagnostics.publish()
        self._requests.keep_connected()

    def end(self, reason: str) -> None:
        """Have the node end; from any thread. Only the first reason counts."""
        self._reasons.put(reason)

    # --- end ------------------------------------------------------------------------------------------------------

    def run(self) -> int:
        """Work until there is a reason to end; return the exit status."""
        pulse = Pulse(lambda: self._engine.alive and self._outbox.alive, lambda: self._engine.turns)
        reason = first_reason(self._reasons, pulse.look)
        if reason == ENGINE_ENDED:
            if pulse.hangs:
                self._replace_engine()
            return self._hand_over()
        if reason != "mission ended":
            self._say_farewell(reason, _FAREWELL_LIMIT_S)
        self._reconnector.stop()
        self._engine.stop()
        state = self._engine.state
        self._outbox.stop()
        status = self._write_result(state)
        self._print_end(reason, state)
        time.sleep(_LAST_WORDS_S)
        self._requests.close()
        return status

    def _say_farewell(self, reason: str, limit_s: float) -> None:
        """Have the engine decide about the end, in flight by a landing; on this thread where its own has ended."""
        self.put(Shutdown(t_ns=self._clock.now_ns(), signal=reason))
        self._farewell.wait(limit_s, self._engine.stand_in)

    def _replace_engine(self) -> None:
        """Have this thread decide, for the one that does hangs; where that hangs too, the process ends.

        Then roslaunch ends all other nodes, of which planner and autopilot node land what flies.
        """
        faulthandler.dump_traceback(_STDERR)  # where it hangs
        faulthandler.dump_traceback_later(_LAST_LANDING_LIMIT_S + _HAND_OVER_LIMIT_S, file=_STDERR, exit=True)
        self._engine.replace()

    def _hand_over(self) -> int:
        """Land what flies, for the thread that decides has ended, and start anew; return when that cannot be.

        There is no result yet, so that the journal is gone on with.
        """
        state = self._engine.state
        for part in (self._land_without_its_thread, self._engine.stop, self._outbox.stop):
            try:
                part()
            except Exception:
                report(_log, "%s failed", part.__name__)
        lines = [*self._cause(ENGINE_ENDED, state), f"autonomy: it starts anew and goes on with {self._journal.path}"]
        print("\n".join(lines), flush=True)
        if self._reasons.empty():  # else somebody has told it to end meanwhile
            start_anew()
        return EXIT_STATUS["ENGINE_FAILED"]

    def _land_without_its_thread(self) -> None:
        if self._engine.state.flight.active:
            self._say_farewell(ENGINE_ENDED, _LAST_LANDING_LIMIT_S)

    def _write_result(self, state: EngineState) -> int:
        status = exit_status(self._ending.results, state)
        folder = self._folder
        result = {
            "data": state.recording.location,
            "data_result": data_outcome(self._ending.results).value,
            "data_summary": data_summary(self._ending.results, state),
            "exit_status": status,
            "in_flight": state.flight.active,
            "journal": str(self._journal.path),
            "report": str(folder / run_folder.REPORT_NAME),
            "result": outcome(self._ending.results, state),
            "state": state.state.value,
        }
        try:
            (folder / run_folder.REPORT_NAME).write_text(self._timeline.text(), encoding="utf-8")
            run_folder.write_result(folder, result)
        except OSError as error:
            print(f"autonomy: the result cannot be written: {error}", file=sys.stderr, flush=True)
        return status

    @property
    def _folder(self) -> Path:
        return self._journal.path.parent

    def _cause(self, reason: str, state: EngineState) -> List[str]:
        flight = " IN FLIGHT" if state.flight.active else ""
        lines = [f"autonomy: ended by {reason}{flight} in {state.state.value}"]
        if self._farewell.text():
            lines.append(f"autonomy: LAND was sent ({self._farewell.text()})")
        return lines

    def _print_end(self, reason: str, state: EngineState) -> None:
        lines = self._cause(reason, state) if reason != "mission ended" else []
        lines.append(f"autonomy: result   {outcome(self._ending.results, state)}")
        lines.append(f"autonomy: bag      {state.recording.location or 'none'}")
        data, said = data_outcome(self._ending.results).value, data_summary(self._ending.results, state)
        if data or said:
            lines.append(f"autonomy: data     {': '.join(each for each in (data, said) if each)}")
        lines.append(f"autonomy: journal  {self._journal.path}")
        lines.append(f"autonomy: report   {self._folder / run_folder.REPORT_NAME}")
        print("\n".join(lines), flush=True)


def decided_again(
    events: List[Event], rules: Rules, messages: MessageLog, ending: Ending, timeline: Timeline
) -> EngineState:
    """Return the state that an unfinished journal leads to; forget its events.

    Args:
        events: of it; none without one.
        rules: by which they were decided.
        messages: take those on the way.
        ending: counts the missions that ended on the way.
        timeline: tells in the report what was decided and said on the way.
    """
    state = EngineState()
    for event in events:
        state, commands = decide(state, event, rules)
        messages.take(event.t_ns, commands)
        timeline.take(event.t_ns, commands)
        ending.count(event, state)
    events.clear()
    return state


def _check_missions(parameters: Parameters, configuration: Configuration) -> None:
    """Refuse to start a run that would wait for a mission for ever."""
    event = choose(configuration.missions, parameters.missions, 0)
    if parameters.missions and parameters.exit_when_ended and isinstance(event, MissionRejected):
        raise StartError(f"mission {event.mission_id!r}: {event.error}")


def _place(parameters: Parameters) -> Place:
    return Place(parameters.output, parameters.runs, rospy.get_name())


def _clock_name() -> str:
    """Return which clock decides, as headers of journals say it."""
    return BOOT_CLOCK if rospy.rostime.is_wallclock() else ROS_CLOCK


def _unfinished(parameters: Parameters, configuration: Configuration) -> Optional[run_folder.Unfinished]:
    """Return the journal to go on with, unless it cannot be read, or was decided by other rules or another clock.

    None of these is a reason not to start: the vehicle may be in the air, and an engine that finds it armed lands it.

    Raises:
        InUseError: Another engine goes on writing it.
    """
    if not parameters.resume:
        return None

    def fits(path: Path, header: Mapping[str, Any]) -> bool:
        why = ""
        if header.get("hash") != configuration.hash:
            why = "was decided by another configuration"
        elif header.get("clock") != _clock_name():
            why = f"is on another clock ({header.get('clock')})"
        if why:
            rospy.logwarn(f"{path} has not ended, but {why}: a new one begins")
        return not why

    try:
        return run_folder.find_unfinished(_place(parameters), fits)
    except InUseError:
        raise
    except StartError as error:
        rospy.logerr(f"{error}. It is kept, and a new one begins.")
        return None


def _propose_forks() -> None:
    """Say how less memory would do, on a computer that has little."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if memory < _LITTLE_MEMORY and rospy.get_param("~processes", "") == "separate":
        rospy.logwarn(
            "This computer has %.1f GB of memory: with processes:=forked the nodes take 100 MB less", memory / 1e9
        )


def _make(stopped: threading.Event) -> AutonomyNode:
    node_main.warn_of_parameters("autonomy")
    parameters = read_parameters()
    node_main.take_precedence_or_say(parameters.nice)
    _propose_forks()
    configuration = load_configuration(parameters.config, parameters.overrides)
    _check_missions(parameters, configuration)
    wait_for_time(stopped)
    unfinished = _unfinished(parameters, configuration)
    stall_limit_ns = configuration.rules.limits.clock_stall_limit_ns
    clock = make_clock(unfinished.last_ns if unfinished is not None else 0, stall_limit_ns)
    label = run_folder.own_label(datetime.now(timezone.utc))
    return AutonomyNode(parameters, configuration, clock, label, unfinished)


def main() -> int:
    """Run the node; return its exit status."""
    answered = answer_words("autonomy", __doc__, node_main.__doc__, node_main.Parameters.__doc__)
    if answered is not None:
        return answered
    node_main.begin("autonomy")
    stopped = threading.Event()
    ends: List[Callable[[str], None]] = [lambda _: stopped.set()]

    node_main.end_by_signals(lambda name: ends[-1](name))
    rospy.core.add_preshutdown_hook(lambda reason: ends[-1](f"ROS ({reason})"))
    try:
        node = _make(stopped)
        ends.append(node.end)
        if stopped.is_set():
            node.end("a signal")
        node.start()
        return node.run()
    except (ConfigError, NodeError) as error:
        print(f"autonomy: {error}", file=sys.stderr, flush=True)
        return START_ERROR
    finally:
        rospy.signal_shutdown("ended")


# --- results ----------------------------------------------------------------------------------------------------------
# How a run ended, as a number for scripts.


START_ERROR = 2

#: What the process exits with, by the name of the worst that happened; docs/integrator.md shows this table.
EXIT_STATUS: Mapping[str, int] = {
    "NO_MISSION": 0,  # the node was ended before one was begun
    "COMPLETE": 0,  # every mission was flown and its data is complete
    "LANDED_EARLY": 3,
    "PILOT": 4,
    "NOT_FLOWN": 5,
    "DATA_INCOMPLETE": 6,  # flown or not, something of a flight was not recorded, or the data was given up
    "INTERRUPTED": 7,  # the node was ended while a mission was under way, on the ground
    "INTERRUPTED_IN_FLIGHT": 8,  # ... and in flight: LAND was sent unless the pilot had control
    "ENGINE_FAILED": 9,  # its thread that decides has ended, LAND was sent as in the row above; it could not start anew
}


def outcome(results: Sequence[Ended], state: EngineState) -> str:
    """Return the worst of how the missions ended and where the engine was when the node ended."""
    names: List[str] = [each.result.value for each in results if each.result is not Result.NONE] or ["NO_MISSION"]
    if state.flight.active:
        names.append("INTERRUPTED_IN_FLIGHT")
    elif state.state not in NOTHING_UNDER_WAY:
        names.append("INTERRUPTED")
    return max(names, key=EXIT_STATUS.__getitem__)


def data_outcome(results: Sequence[Ended]) -> DataResult:
    """Return what became of the data of all missions; NONE where nothing was recorded."""
    known = [each.data for each in results]
    return next((each for each in (DataResult.INCOMPLETE, DataResult.COMPLETE) if each in known), DataResult.NONE)


def data_summary(results: Sequence[Ended], state: EngineState) -> str:
    """Return what the recorder says of the data; of several missions, by session, of that which lacks something."""
    lacking = [f"{each.session}: {each.said or 'given up'}" for each in results if each.data is DataResult.INCOMPLETE]
    return "; ".join(lacking) if lacking and len(results) > 1 else said_of_data(state)


def exit_status(results: Sequence[Ended], state: EngineState) -> int:
    """Return the exit status of the node: the worse of what became of the flights and of their data."""
    data = "DATA_INCOMPLETE" if data_outcome(results) is DataResult.INCOMPLETE else "COMPLETE"
    return max(EXIT_STATUS[outcome(results, state)], EXIT_STATUS[data])
