"""What can happen next, and what happens then: one move is one thing that a peer, a user or time does."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Tuple

from proof_peers import BATTERIES, MISSIONS, RULES, SCENES, UNIT, Peers, beat, say, unheard

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.events import Check, CheckName, Verdict
from amaze_autonomy.engine.rules import Code, Rules
from amaze_autonomy.engine.state import EngineState, State, Step, evolve
from amaze_autonomy.laws import Moment, Witness, observed

Move = Tuple[str, ...]
WRONG = "wrong"
"""A mission that is selected and that no file describes."""
_PHYSICS = {
    "ground": ("armed",),
    "armed": ("ground", "lifting"),
    "lifting": ("flying", "landing"),
    "flying": ("loitering", "landing"),
    "loitering": ("flying", "landing"),
    "landing": ("touched", "ground"),
    "touched": ("ground",),
}


class Node(NamedTuple):
    """One state of everything: the engine, its peers, the witness, and requests whose answers may still come late."""

    state: EngineState
    peers: Peers
    witness: Witness
    old: Tuple[int, ...] = (0, 0, 0)


BOOT = Node(EngineState(), Peers(), Witness())


@dataclass(frozen=True)
class World:
    """What can happen in one exploration; what is not named here does not happen in it.

    Args:
        name: of the world.
        words: what it is about, and what it leaves to others.
        seeds: ways from boot to where the exploration begins.
        scenes: which scenes of the vehicle may follow by nature.
        anytime: scenes that may come at any time, and be left to any scene of `scenes`.
        codes: component -> (code, restart) that it may have; NOMINAL is always possible.
        failing: how many components may fail at the same time.
        users_later: commands of the user that come together with a unit of time: no wake-up before them.
        at_once: components that fail together in one message, each as name=code.
        clocks: for how many seconds the clock that decides stands.
        lies: peer=status, said in one message; the next one is the truth again.
        checks: check -> answers; all others are answered well by one move.
        stop: places that are not gone on from; another world begins there.
    """

    name: str
    words: str
    seeds: Tuple[Tuple[Move, ...], ...]
    rules: Rules = RULES
    scenes: Mapping[str, Tuple[str, ...]] = field(default_factory=lambda: _PHYSICS)
    anytime: Tuple[str, ...] = ()
    batteries: Tuple[str, ...] = ()
    detections: Tuple[str, ...] = ()
    planner: Tuple[str, ...] = ()
    recorder: Tuple[str, ...] = ()
    codes: Mapping[str, Tuple[Tuple[int, str], ...]] = field(default_factory=dict)
    failing: int = 1
    silences: Tuple[str, ...] = ()
    quiet: int = 1
    users: Tuple[str, ...] = ()
    users_later: Tuple[str, ...] = ()
    at_once: Tuple[Tuple[str, ...], ...] = ()
    lies: Tuple[str, ...] = ()
    clocks: Tuple[str, ...] = ()
    missions: Tuple[Tuple[str, ...], ...] = ()
    checks: Mapping[str, Tuple[str, ...]] = field(default_factory=dict)
    motion: Tuple[str, ...] = ("ACCEPTED", "REFUSED")
    load: Tuple[str, ...] = ("ACCEPTED",)
    recording: Tuple[str, ...] = ("ACCEPTED",)
    late: bool = False
    noise: bool = False
    shutdown: bool = False
    restart: bool = False
    away: bool = False
    order: Tuple[str, ...] = ("wait",)
    stop: Tuple[State, ...] = ()


# --- which moves there are --------------------------------------------------------------------------------------------


def moves_of(node: Node, world: World) -> List[Tuple[Move, bool]]:
    """Return every move that is possible now; True: a fair one, that cannot be withheld for ever."""
    found: List[Tuple[Move, bool]] = [((order,), True) for order in world.order]
    found += [(move, True) for move in _replies(node, world)]
    found += [(move, False) for move in _changes(node, world)]
    if world.late:
        found += [(move, False) for move in _late(node)]
    found += [(("user", command), False) for command in world.users]
    found += [(("user_later", command), False) for command in world.users_later]
    found += [(("at_once", *components), False) for components in world.at_once if not node.peers.components]
    found += [(("clock", s), False) for s in world.clocks if float(s) != node.state.peers.clock_stalled_s]
    found += [(("lie", lie), False) for lie in world.lies if _can_lie(node, lie)]
    if world.missions and node.state.state in (State.MISSION_INPUT, State.MISSION_ENDED):
        found += [(("select", *missions), False) for missions in world.missions]
    if world.noise:
        found.append((("noise",), False))
    if world.shutdown and not node.state.shutting_down:
        found.append((("shutdown",), False))
    if world.restart:
        found.append((("restart",), False))
    if world.away:
        found += [(("away",), False), (("stood",), False)]
    return found


def _replies(node: Node, world: World) -> Iterator[Move]:
    state, rest = node.state, False
    for record in state.preflight.checks if _asks(state) else ():
        if record.outcome is None:
            if record.check.value in world.checks:
                for answer in world.checks[record.check.value]:
                    yield ("check", record.check.value, answer)
            else:
                rest = True
    if rest:
        yield ("checks", "ok")
    if (
        state.flight.motion.id
        and state.flight.motion.outcome is None
        and state.state in (State.TAKEOFF, State.HOLD, State.LAND)
    ):
        yield from (("reply", "motion", outcome) for outcome in world.motion)
    if state.preflight.load.id and state.preflight.load.outcome is None and _loads(state):
        yield from (("reply", "load", outcome) for outcome in world.load)
    recorded = state.recording.request.id and state.recording.request.outcome is None
    if recorded and state.state in (State.START_RECORDING, State.DATA_CLEANUP):
        yield from (("reply", "recording", outcome) for outcome in world.recording)


def _asks(state: EngineState) -> bool:
    return state.state in (State.PREFLIGHT, State.LOAD_MISSION) or state.step is Step.TOUCHDOWN


def _loads(state: EngineState) -> bool:
    return state.state is State.LOAD_MISSION or state.step is Step.TOUCHDOWN


def _changes(node: Node, world: World) -> Iterator[Move]:
    peers, state = node.peers, node.state
    if "autopilot" not in peers.silent:
        following = world.scenes.get(peers.vehicle)
        scenes = tuple(world.scenes) if following is None else following
        yield from (("vehicle", scene) for scene in (*scenes, *world.anytime) if scene != peers.vehicle)
        yield from (("battery", level) for level in world.batteries if level != peers.battery)
    if "landing" not in peers.silent:
        yield from (("detection", said) for said in world.detections if said != peers.detection)
    if node.witness.load is not None and "planner" not in peers.silent:
        said = peers.planner + ("!" if peers.done else "")
        yield from (("planner", phase) for phase in world.planner if phase != said or phase == "LOADED")
    if node.witness.recording != "none" and state.session.id and "recorder" not in peers.silent:
        yield from (("recorder", phase) for phase in world.recorder if phase != peers.recorder)
    if "watchdog" not in peers.silent:
        yield from _components(peers, world)
    for peer in world.silences:
        if peer in peers.silent:
            yield ("return", peer)
        elif len(peers.silent) < world.quiet:
            yield ("silence", peer)


def _components(peers: Peers, world: World) -> Iterator[Move]:
    now = {name: (code, restart) for name, code, restart in peers.components}
    failing = sum(code > 1 for code, _ in now.values())
    for name, codes in world.codes.items():
        is_now = now.get(name, (1, "none"))
        for code, restart in ((1, "none"), *codes):
            room = is_now[0] > 1 or failing < world.failing
            if (code, restart) != is_now and (code == 1 or room):
                yield ("component", name, str(code), restart)


def lie_in(node: Node, number: int) -> Optional[Move]:
    """Return the lie whose turn it is in a state of that number; None: nothing flies, or nobody is there who could."""
    move = LIES[number % len(LIES)]
    return move if node.state.flight.active and _can_lie(node, move[1]) else None


def _speaker(peer: str) -> str:
    """Return who says it: of its battery the autopilot speaks."""
    return "autopilot" if peer == "battery" else peer


def _can_lie(node: Node, lie: str) -> bool:
    """Return True when a peer speaks, of our session, and the lie is none of what it says already."""
    peer, _, said = lie.partition("=")
    speaker = _speaker(peer)
    told = {"planner": node.peers.planner, "recorder": node.peers.recorder}.get(peer, "-")
    now = {"planner": node.peers.planner, "recorder": node.peers.recorder, "landing": node.peers.detection}.get(peer)
    unheard_now = {*unheard(speaker)} & {*node.peers.silent}
    return not unheard_now and bool(told) and bool(node.state.session.id) and now != said


def _late(node: Node) -> Iterator[Move]:
    motion, load, check = node.old
    if motion:
        yield ("late", "motion")
    if load:
        yield ("late", "load")
    if check:
        yield ("late", "check")


# --- what a move does -------------------------------------------------------------------------------------------------

Observer = Callable[[Moment], None]
Events = Iterator[Tuple[ev.Event, Optional[Peers]]]


def perform(node: Node, move: Move, rules: Rules, observe: Optional[Observer] = None) -> Node:
    """Return what a move leads to; `observe` sees every moment of it, and may raise `BrokenLawError`."""
    state, peers, witness, old = node
    for make in _SCRIPTS[move[0]](node, move):
        if isinstance(make, Peers):
            peers = make
            continue
        event = make(peers, state, witness, old)
        if event is None:
            continue
        after, commands = engine.decide(state, event, rules)
        moment = observed(witness, state, event, commands, after, rules)
        if observe is not None:
            observe(moment)
        old = _superseded(old, state, after)
        if after.session.id != state.session.id:
            peers = peers._replace(planner="", recorder="", done=False, leg=(0, 0))
        state, witness = after, moment.seen
    return Node(state, peers, witness, old)


def _superseded(old: Tuple[int, ...], before: EngineState, after: EngineState) -> Tuple[int, ...]:
    motion, load, check = old
    if before.flight.motion.id and before.flight.motion.id != after.flight.motion.id:
        motion = before.flight.motion.id
    if before.preflight.load.id and before.preflight.load.id != after.preflight.load.id:
        load = before.preflight.load.id
    if (
        before.preflight.checks
        and after.preflight.checks
        and before.preflight.checks[0].command_id != after.preflight.checks[0].command_id
    ):
        check = before.preflight.checks[0].command_id
    return (motion, load, check)


Make = Callable[[Peers, EngineState, Witness, Tuple[int, ...]], Optional[ev.Event]]


def _says(peer: str) -> Make:
    return lambda peers, state, _witness, _old: say(peer, peers, state)


_SAY = {peer: _says(peer) for peer in ("autopilot", "watchdog", "info", "planner", "recorder", "landing")}


def _tick(by: int) -> Make:
    return lambda _peers, state, _witness, _old: ev.Tick(t_ns=state.t_ns + by)


_TICK_UNIT, _TICK_NOW = _tick(UNIT), _tick(0)


def _wait(node: Node, _move: Move) -> Iterator[Any]:
    """A unit of time passes: first the engine wakes, then everybody speaks."""
    yield _TICK_UNIT
    for peer in beat(node.peers, node.state):
        yield _if_in_session(peer)
    yield _TICK_NOW


def _beat(node: Node, _move: Move) -> Iterator[Any]:
    """A unit of time passes: first everybody speaks, then the engine wakes."""
    later = UNIT
    for peer in beat(node.peers, node.state):
        yield _later(peer, later)
        later = 0
    yield _TICK_NOW if later == 0 else _TICK_UNIT


def _if_in_session(peer: str) -> Make:
    def make(peers: Peers, state: EngineState, _witness: Witness, _old: Tuple[int, ...]) -> Optional[ev.Event]:
        told = {"planner": peers.planner, "recorder": peers.recorder}.get(peer, "-")
        return say(peer, peers, state) if told else None

    return make


def _later(peer: str, by: int) -> Make:
    inner = _if_in_session(peer)

    def make(peers: Peers, state: EngineState, witness: Witness, old: Tuple[int, ...]) -> Optional[ev.Event]:
        event = inner(peers, state, witness, old)
        return event if event is None or not by else evolve(event, t_ns=state.t_ns + by)

    return make


def _vehicle(node: Node, move: Move) -> Iterator[Any]:
    yield node.peers._replace(vehicle=move[1])
    yield _SAY["autopilot"]


def _battery(node: Node, move: Move) -> Iterator[Any]:
    yield node.peers._replace(battery=move[1])
    yield _SAY["autopilot"]


def _detection(node: Node, move: Move) -> Iterator[Any]:
    yield node.peers._replace(detection=move[1])
    yield _SAY["landing"]


def _planner(node: Node, move: Move) -> Iterator[Any]:
    phase, done = move[1].rstrip("!"), move[1].endswith("!")
    leg = (node.state.session.repetition, node.state.session.file_index) if phase == "LOADED" else node.peers.leg
    yield node.peers._replace(planner=phase, done=done, leg=leg)
    yield _SAY["planner"]


def _recorder(node: Node, move: Move) -> Iterator[Any]:
    yield node.peers._replace(recorder=move[1])
    yield _SAY["recorder"]


def _component(node: Node, move: Move) -> Iterator[Any]:
    known = {name: (code, restart) for name, code, restart in node.peers.components}
    known[move[1]] = (int(move[2]), move[3])
    listed = tuple((name, *known[name]) for name in sorted(known) if known[name][0] > 1)
    yield node.peers._replace(components=listed)
    yield _SAY["watchdog"]
    yield _SAY["info"]


def _silence(node: Node, move: Move) -> Iterator[Any]:
    yield node.peers._replace(silent=tuple(sorted({*node.peers.silent, move[1]})))


def _return(node: Node, move: Move) -> Iterator[Any]:
    yield node.peers._replace(silent=tuple(peer for peer in node.peers.silent if peer != move[1]))
    yield _if_in_session("watchdog" if move[1] == "loop" else move[1].rpartition("-")[2])


_BROKEN = ev.ComponentStatus("imu", Code.ABORT, ev.Restart.NONE, None, "it is broken")
_ANSWERS: Dict[str, Dict[str, Any]] = {
    "ok": {"outcome": ev.Outcome.ACCEPTED, "ok": True, "checks": (Check("row", Verdict.PASS),)},
    "warn": {"outcome": ev.Outcome.ACCEPTED, "ok": True, "checks": (Check("row", Verdict.WARN),)},
    "fail": {"outcome": ev.Outcome.ACCEPTED, "ok": False, "checks": (Check("row", Verdict.FAIL),)},
    "unknown": {"outcome": ev.Outcome.ACCEPTED, "ok": True, "checks": (Check("row", Verdict.UNKNOWN),)},
    "fixable": {"outcome": ev.Outcome.ACCEPTED, "ok": False, "fixable": True, "being_fixed": True},
    "lacks": {"outcome": ev.Outcome.ACCEPTED, "ok": True, "components": (_BROKEN,)},
    "refused": {"outcome": ev.Outcome.REFUSED, "ok": True},
    "unavailable": {"outcome": ev.Outcome.UNAVAILABLE},
    "timed_out": {"outcome": ev.Outcome.TIMED_OUT, "ok": True},
    "broken": {"outcome": ev.Outcome.BROKEN, "ok": True},
}


def _check_reply(check: CheckName, identity: int, answer: str) -> Make:
    return lambda _peers, state, _witness, _old: ev.CheckReply(
        t_ns=state.t_ns, command_id=identity, check=check, **_ANSWERS[answer]
    )


def _check(node: Node, move: Move) -> Iterator[Any]:
    for record in node.state.preflight.checks:
        if record.check.value == move[1]:
            yield _check_reply(record.check, record.command_id, move[2])


def _checks(node: Node, _move: Move) -> Iterator[Any]:
    """Every check that is open and of no interest here passes."""
    for record in node.state.preflight.checks:
        if record.outcome is None and not (len(_move) > 2 and record.check.value in _move[2:]):
            yield _check_reply(record.check, record.command_id, "ok")


def _reply(node: Node, move: Move) -> Iterator[Any]:
    state = node.state
    identity = {
        "motion": state.flight.motion.id,
        "load": state.preflight.load.id,
        "recording": state.recording.request.id,
    }[move[1]]
    yield lambda _p, now, _w, _o: ev.Reply(t_ns=now.t_ns, command_id=identity, outcome=ev.Outcome[move[2]])


def _late_reply(node: Node, move: Move) -> Iterator[Any]:
    identity = node.old[("motion", "load", "check").index(move[1])]
    if move[1] == "check":
        yield _check_reply(CheckName.WATCHDOG, identity, "fail")
        return
    for outcome in (ev.Outcome.REFUSED, ev.Outcome.ACCEPTED):
        yield _outcome(identity, outcome)


def _outcome(identity: int, outcome: ev.Outcome) -> Make:
    return lambda _p, now, _w, _o: ev.Reply(t_ns=now.t_ns, command_id=identity, outcome=outcome)


def _user(_node: Node, move: Move) -> Iterator[Any]:
    yield lambda _p, now, _w, _o: ev.UserRequest(t_ns=now.t_ns, command=ev.UserCommand(move[1]), request_id=7)


def _user_later(_node: Node, move: Move) -> Iterator[Any]:
    yield lambda _p, now, _w, _o: ev.UserRequest(t_ns=now.t_ns + UNIT, command=ev.UserCommand(move[1]), request_id=7)


def _clock(_node: Node, move: Move) -> Iterator[Any]:
    yield lambda _p, now, _w, _o: ev.ClockStatus(t_ns=now.t_ns, stalled_s=float(move[1]))


def _at_once(node: Node, move: Move) -> Iterator[Any]:
    """Several components fail in one message."""
    failed = sorted(part.split("=") for part in move[1:])
    yield node.peers._replace(components=tuple((name, int(code), "none") for name, code in failed))
    yield _SAY["watchdog"]
    yield _SAY["info"]


_LIES: Dict[str, Callable[[Peers, str], Peers]] = {
    "autopilot": lambda peers, said: peers._replace(vehicle=said),
    "battery": lambda peers, said: peers._replace(battery=said),
    "landing": lambda peers, said: peers._replace(detection=said),
    "planner": lambda peers, said: peers._replace(planner=said.rstrip("!"), done=said.endswith("!")),
    "recorder": lambda peers, said: peers._replace(recorder=said),
    "watchdog": lambda peers, _said: peers._replace(components=()),
}
LIES: Tuple[Move, ...] = tuple(
    ("lie", f"{peer}={said}")
    for peer, all_said in (
        ("autopilot", SCENES),
        ("battery", BATTERIES),
        ("landing", ev.Landed.__members__),
        ("planner", (*ev.MissionPhase.__members__, "LANDED!")),
        ("recorder", (*ev.RecordingPhase.__members__, "STALLED", "LOST")),
        ("watchdog", ("nothing is wrong",)),
    )
    for said in all_said
)
"""Whatever a peer can say, said once though it is not so; a code 16 lands whoever says it, and is none of them."""


def _lie(node: Node, move: Move) -> Iterator[Any]:
    """One message is wrong; the next one is the truth again."""
    peer, _, said = move[1].partition("=")
    speaker = _speaker(peer)
    yield _LIES[peer](node.peers, said)
    yield _SAY[speaker]
    yield node.peers
    yield _SAY[speaker]


def _truth(_node: Node, move: Move) -> Iterator[Any]:
    """What a lie is measured against: the same peer, twice the truth."""
    speaker = _speaker(move[1].partition("=")[0])
    yield _SAY[speaker]
    yield _SAY[speaker]


def _select(_node: Node, move: Move) -> Iterator[Any]:
    if move[1] == WRONG:
        yield lambda _p, now, _w, _o: ev.MissionRejected(t_ns=now.t_ns, mission_id=WRONG, error="no such", request_id=7)
        return
    missions = tuple(MISSIONS[name] for name in move[1:])
    yield lambda _p, now, _w, _o: ev.MissionSelected(t_ns=now.t_ns, missions=missions, request_id=7)


def _shutdown(_node: Node, _move: Move) -> Iterator[Any]:
    yield lambda _p, now, _w, _o: ev.Shutdown(t_ns=now.t_ns, signal="SIGTERM")


def _restart(_node: Node, _move: Move) -> Iterator[Any]:
    """The process is killed and started again with its journal: what it decided is decided again, time has passed."""
    yield lambda _p, now, _w, _o: ev.EngineStarted(t_ns=now.t_ns + UNIT, label="proof", resumed=True)


def _away(_node: Node, _move: Move) -> Iterator[Any]:
    """The same, much later."""
    yield lambda _p, now, _w, _o: ev.EngineStarted(t_ns=now.t_ns + 3 * UNIT, label="proof", resumed=True)


def _stood(_node: Node, _move: Move) -> Iterator[Any]:
    """The process did not run for as long, and goes on: the first that it hears of is that."""
    yield lambda _p, now, _w, _o: ev.Tick(t_ns=now.t_ns, away_ns=3 * UNIT)


def _start(_node: Node, _move: Move) -> Iterator[Any]:
    yield lambda _p, now, _w, _o: ev.EngineStarted(t_ns=now.t_ns + UNIT, label="proof")


def _noise(_node: Node, _move: Move) -> Iterator[Any]:
    """Everything that must not count: too old, from the future, of another session, to nobody."""
    yield from _NOISE


def _noisy(kind: type, **fields: Any) -> Make:
    return lambda _p, now, _w, _o: kind(t_ns=now.t_ns, **fields)


_BAD_VEHICLE = {"armed": False, "landed": ev.VehicleLanded.ON_GROUND, "pilot_in_control": True}
_NOISE: Tuple[Make, ...] = (
    _noisy(ev.AutopilotStatus, **_BAD_VEHICLE, age_ns=9 * UNIT),
    _noisy(ev.AutopilotStatus, **_BAD_VEHICLE, age_ns=-9 * UNIT),
    _noisy(ev.WatchdogAction, sequence=0, loop_counter=10**9, code=Code.NOMINAL, age_ns=9 * UNIT),
    _noisy(ev.WatchdogAction, sequence=0, loop_counter=10**9, code=Code.ABORT, age_ns=-9 * UNIT),
    _noisy(ev.MissionStatus, session_id="other", mission_id="one", phase=ev.MissionPhase.FAILED),
    _noisy(ev.MissionStatus, session_id="", mission_id="one", phase=ev.MissionPhase.LANDED, waypoint=3, waypoints=3),
    _noisy(ev.WatchdogInfo, sequence=0, changed=(), components=(), age_ns=9 * UNIT),
    _noisy(ev.RecordingStatus, session_id="other", phase=ev.RecordingPhase.COMPLETE),
    _noisy(ev.RecordingStatus, session_id="", phase=ev.RecordingPhase.FAILED),
    _noisy(ev.LandedStatus, landed=ev.Landed.AIRBORNE, age_ns=9 * UNIT),
    _noisy(ev.Reply, command_id=10**9, outcome=ev.Outcome.ACCEPTED),
    _noisy(ev.CheckReply, command_id=10**9, check=CheckName.WATCHDOG, outcome=ev.Outcome.ACCEPTED, ok=True),
)

_SCRIPTS: Dict[str, Callable[[Node, Move], Iterator[Any]]] = {
    "at_once": _at_once,
    "away": _away,
    "battery": _battery,
    "beat": _beat,
    "check": _check,
    "checks": _checks,
    "clock": _clock,
    "component": _component,
    "detection": _detection,
    "late": _late_reply,
    "lie": _lie,
    "noise": _noise,
    "planner": _planner,
    "recorder": _recorder,
    "reply": _reply,
    "restart": _restart,
    "return": _return,
    "select": _select,
    "shutdown": _shutdown,
    "silence": _silence,
    "start": _start,
    "stood": _stood,
    "truth": _truth,
    "user": _user,
    "user_later": _user_later,
    "vehicle": _vehicle,
    "wait": _wait,
}
