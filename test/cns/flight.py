"""Our engine, the peers that CNS nodes are to it, stand-ins for those nodes, the simulated world; in virtual time."""

from __future__ import annotations

import json
from typing import Any, Callable, Dict, List, Tuple, Union

from stand_ins import ARM, DISARM, LAND, STAND_INS, TAKEOFF, namespace

from amaze_autonomy.cns.peers import Call, Folder, LandingDetection, Publish, Recorder, StateEstimation, Watchdog
from amaze_autonomy.cns.sequencer import ANYWHERE, Bounds, Sequencer
from amaze_autonomy.cns.tables import PEERS
from amaze_autonomy.engine.commands import Command, Decision, Notify, Request
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    EngineStarted,
    Event,
    LandedStatus,
    MissionSelected,
    MissionStatus,
    Tick,
    UserCommand,
    UserRequest,
)
from amaze_autonomy.engine.state import EngineState, State
from amaze_autonomy.engine.timers import next_deadline
from amaze_autonomy.interface import service_of
from amaze_autonomy.simulation import World

S, MS = 1_000_000_000, 1_000_000
ENDS = (State.MISSION_ENDED, State.OUTREACH)
ENTITIES = ("mission_cam", "lrf", "px4_imu", "UWB-Tag 1", "px4_gps")
WHOLE = [ARM, TAKEOFF, LAND, DISARM]
_Heard = Tuple[int, str, str, Dict[str, Any]]  # when it arrives, hear or returned, key, fields


class Flight:
    """One session.

    Args:
        configuration: of the engine.
        mission: to be flown.
        bounds: of the sequencer.
        latency_ns: how long each message, call and answer is under way between a peer and its node.
        first: which of its two topics is heard first when the watchdog says something on both: log or heartbeat.
        faults: of the stand-ins, by the peer's name.
    """

    def __init__(
        self,
        configuration: Any,
        mission: str = "1",
        bounds: Bounds = ANYWHERE,
        latency_ns: int = 0,
        first: str = "log",
        **faults: Dict[str, Any],
    ) -> None:
        self.configuration, self.rules = configuration, configuration.rules
        self.world = World(configuration, without=PEERS)
        self.vehicle = self.world.vehicle
        self.nodes = {kind.peer: kind(self.vehicle, **faults.get(kind.peer, {})) for kind in STAND_INS}
        self._bounds = bounds
        self.peers = self._make_peers()
        self.state = EngineState()
        self.t_ns = 0
        self.decisions: List[Decision] = []
        self.notices: List[str] = []
        self.planner: List[MissionStatus] = []
        self.landed: List[LandedStatus] = []
        self.dead: Tuple[str, ...] = ()
        self._latency_ns, self._first = latency_ns, first
        self._to_node: Dict[str, List[Tuple[int, Union[Call, Publish]]]] = {name: [] for name in self.nodes}
        self._to_peer: Dict[str, List[_Heard]] = {name: [] for name in self.nodes}
        self.away = False
        self._take(EngineStarted(t_ns=0, label="cns"))
        self.run(2 * S)
        self.select(mission)

    def _make_peers(self) -> Dict[str, Any]:
        rules, streams, plans = self.rules, self.configuration.streams, self.configuration.plans
        return {
            "watchdog": Watchdog(rules, self.configuration.missions, streams.watchdog_action_rate_hz),
            "landing_detection": LandingDetection(rules, streams.landing_detection_rate_hz),
            "state_estimation": StateEstimation(rules),
            "mission_planner": Sequencer(plans, rules.limits, streams.planner_status_rate_hz, self._bounds),
            "data_recorder": Recorder({"main": "/data/main"}, 3 * S, 60 * S, streams.recorder_status_rate_hz),
        }

    # --- what is seen ---------------------------------------------------------------------------------------------

    def requests(self) -> List[int]:
        """Return what the sequencer was asked, in order."""
        return [fields["request"] for key, fields in self.nodes["mission_planner"].calls if key == "request"]

    def calls(self, peer: str) -> List[Tuple[str, Dict[str, Any]]]:
        return self.nodes[peer].calls

    @property
    def states(self) -> List[str]:
        """Return the states that the engine went through."""
        found: List[str] = []
        for decision in self.decisions:
            if not found or found[-1] != decision.after:
                found.append(decision.after)
        return found

    # --- time -----------------------------------------------------------------------------------------------------

    def select(self, mission: str) -> None:
        self._take(MissionSelected(t_ns=self.t_ns, missions=(self.configuration.plan(mission).mission,)))

    def ask(self, command: UserCommand) -> None:
        self._take(UserRequest(t_ns=self.t_ns, command=command))

    def run(self, duration_ns: int) -> None:
        self.until(lambda: False, duration_ns, must=False)

    def until(self, condition: Callable[[], Any], limit_ns: int = 300 * S, *, must: bool = True) -> None:
        end_ns = self.t_ns + limit_ns
        while self.t_ns < end_ns and not condition():
            self._step(self.t_ns + 20 * MS)
        assert not must or condition(), f"not within {limit_ns / S} s: {self.state.state} {self.notices[-3:]}"

    def end(self, limit_ns: int = 300 * S) -> str:
        """Go on until it ends or somebody is needed; return the state."""
        self.until(lambda: self.state.state in ENDS, limit_ns)
        return self.state.state.value

    def restart_node(self, name: str, away_ns: int) -> None:
        """Have one of their nodes die, and another one come that knows nothing."""
        self.dead += (name,)
        self.run(away_ns)
        self.dead = tuple(each for each in self.dead if each != name)
        self.nodes[name].start_again()

    def restart(self, away_ns: int = 3 * S) -> None:
        """Have the node that the peers are in die, and another one come that has what was kept."""
        kept = json.loads(json.dumps({name: peer.kept() for name, peer in self.peers.items()}))
        self.away = True
        self.run(away_ns)
        self.away, self.peers = False, self._make_peers()
        for name, each in kept.items():
            if each:
                self.peers[name].restore(self.t_ns, each)

    def _step(self, t_ns: int) -> None:
        self.t_ns = t_ns
        for event in self.world.advance(t_ns):
            if isinstance(event, AutopilotStatus) and not self.away:
                self.peers["mission_planner"].see_vehicle(t_ns, armed=event.armed)
            self._take(event)
        recorder = self.nodes["data_recorder"]
        self.peers["data_recorder"].look(t_ns, "main", Folder(recorder.written, recorder.open_files))
        for name in self.peers:
            self._exchange(t_ns, name)
            self._step_peer(t_ns, name)
        deadline_ns = next_deadline(self.state, self.rules)
        if deadline_ns is not None and deadline_ns <= t_ns:
            self._take(Tick(t_ns=t_ns))

    def _step_peer(self, t_ns: int, name: str) -> None:
        if self.away:
            return
        for event in self.peers[name].step(t_ns):
            if isinstance(event, MissionStatus):
                self.planner.append(event)
            if isinstance(event, LandedStatus):
                self.landed.append(event)
            self._take(event)
        self._send(t_ns, name)

    def _exchange(self, t_ns: int, name: str) -> None:
        """Hand over what has arrived. As in the node of the peers, there is a step after each message."""
        node, peer = self.nodes[name], self.peers[name]
        peer.alive = name not in self.dead
        if name in self.dead:
            self._to_node[name], self._to_peer[name] = [], []
            return
        self._arrive(t_ns, name)
        node.step(t_ns)
        said, node.said = node.said, []
        returned, node.returned = node.returned, []
        if self.away:
            self._to_peer[name] = []
            return
        said.sort(key=lambda each: self._first == "heartbeat" and each[0] == "log")
        due_ns, under_way = t_ns + self._latency_ns, self._to_peer[name]
        under_way += [(due_ns, "hear", key, fields) for key, fields in said]
        under_way += [(due_ns, "returned", key, fields) for key, fields in returned]
        while under_way and under_way[0][0] <= t_ns:
            _, how, key, fields = under_way.pop(0)
            if how == "hear":
                peer.hear(t_ns, key, namespace(fields))
            else:
                peer.returned(t_ns, key, namespace(fields), "")
            self._step_peer(t_ns, name)

    def _send(self, t_ns: int, name: str) -> None:
        outbox, self.peers[name].outbox = self.peers[name].outbox, []
        if name not in self.dead:
            self._to_node[name] += [(t_ns + self._latency_ns, each) for each in outbox]
            self._arrive(t_ns, name)

    def _arrive(self, t_ns: int, name: str) -> None:
        node, under_way = self.nodes[name], self._to_node[name]
        while under_way and under_way[0][0] <= t_ns:
            _, each = under_way.pop(0)
            (node.call if isinstance(each, Call) else node.take)(t_ns, each.key, dict(each.fields))

    def _take(self, event: Event) -> None:
        self.state, commands = decide(self.state, event, self.rules)
        for command in commands:
            self._carry_out(command)

    def _carry_out(self, command: Command) -> None:
        if isinstance(command, Decision):
            self.decisions.append(command)
        elif isinstance(command, Notify):
            self.notices.append(command.text)
        service = service_of(command) if isinstance(command, Request) else None
        if service is None:
            return
        if self.away and service.peer in self.peers:
            return  # nobody answers: the engine's own limit ends it
        if service.peer not in self.peers:
            self.world.handle(self.t_ns, command)
            return
        reply = self.peers[service.peer].carry_out(self.t_ns, service, command)
        self._send(self.t_ns, service.peer)
        if reply is not None:
            self._take(reply)


def flying(flight: Flight) -> None:
    """Let it fly its mission for a while."""
    flight.until(lambda: flight.state.state is State.MISSION)
    flight.run(3 * S)
