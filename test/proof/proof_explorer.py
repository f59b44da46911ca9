"""The explorer: breadth first over every state that the moves of a world can reach, every law checked at each event."""

from __future__ import annotations

import time
import zlib
from dataclasses import dataclass, field
from typing import Any, Counter, Dict, List, Optional, Set, Tuple

from proof_key import Key, make_key
from proof_moves import BOOT, Move, Node, Observer, World, lie_in, moves_of, perform
from proof_peers import unheard
from proof_sound import sound

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.state import State
from amaze_autonomy.laws import BrokenLawError, judge

AND = "; "
"""Between what a world reached."""
_SAMPLE = 101
"""Of so many states one is kept, and compared with another one of the same key."""
_UNHEARD = unheard("autopilot")
_PATIENCE = 10
"""Units of time in which a landing ends once the vehicle is down; more than any limit of the worlds."""


@dataclass(frozen=True)
class Broken:
    """A law that does not hold, and the shortest way there from boot."""

    law: str
    why: str
    path: Tuple[Move, ...]


@dataclass
class Stats:
    """What an exploration counted."""

    states: int = 0
    transitions: int = 0
    events: int = 0
    lies: int = 0
    depth: int = 0
    seconds: float = 0.0
    stopped: int = 0
    cut: int = 0
    compared: int = 0
    applied: Dict[str, int] = field(default_factory=dict)
    rules: Dict[str, int] = field(default_factory=dict)
    failures: Set[Tuple[str, str]] = field(default_factory=set)
    places: Set[Tuple[str, str]] = field(default_factory=set)
    commands: Counter[str] = field(default_factory=Counter)
    words: Counter[str] = field(default_factory=Counter)

    @property
    def decided(self) -> Dict[str, str]:
        """Return of each kind of command how many there were, and a digest of what stood in them, in any order."""
        return {kind: f"{count} ({self.words[kind]:08x})" for kind, count in sorted(self.commands.items())}

    @property
    def reached(self) -> str:
        """Return rules, places, failures with their actions, and laws that had something to say, by their names."""
        places, failures = (" ".join(each).strip() for each in self.places), map(" -> ".join, self.failures)
        return AND.join(sorted({*self.rules, *places, *failures, *self.applied}))


class Exploration:
    """One world, explored."""

    def __init__(self, world: World, *, compare: bool = True) -> None:
        self.world, self.compare = world, compare
        self.key = make_key(world.rules)
        self.stats = Stats()
        self.index: Dict[Key, int] = {}
        self.origin: List[Tuple[int, Move]] = []
        self.seeds: List[Tuple[Move, ...]] = []
        self.fair: List[List[int]] = []
        self.where: List[Tuple[State, bool, bool]] = []
        self.kept: Dict[int, Optional[Node]] = {}
        self.broken: Optional[Broken] = None
        self._settles: Set[Key] = set()
        self._observe = self._observer()

    def run(self, limit: Optional[int] = None) -> Exploration:
        """Explore layer by layer until nothing is new, a law is broken, or `limit` transitions are done."""
        begin = time.process_time()
        try:
            self._run(limit)
        finally:
            self.stats.seconds = time.process_time() - begin
            self.stats.states = len(self.index)
        return self

    def _run(self, limit: Optional[int]) -> None:
        layer = self._first_layer()
        stats, world = self.stats, self.world
        while layer and self.broken is None:
            if limit is not None and stats.transitions >= limit:
                stats.cut = len(layer)
                break
            stats.depth += 1
            following: List[Tuple[int, Node]] = []
            for number, node in layer:
                if node.state.state in world.stop:
                    stats.stopped += 1
                    continue
                self._expand(number, node, following)
                if self.broken is None and node.state.state in (State.LAND, State.PILOT):
                    self._settle(number, node)
                if self.broken is not None:
                    return
            layer = following

    def _first_layer(self) -> List[Tuple[int, Node]]:
        layer: List[Tuple[int, Node]] = []
        for seed in self.world.seeds:
            node = BOOT
            for number, move in enumerate(seed):
                try:
                    node = perform(node, move, self.world.rules, self._observe)
                except BrokenLawError as broken:
                    self.broken = Broken(broken.law, broken.why, seed[: number + 1])
                    return []
            self.seeds.append(seed)
            self._add(node, (-len(self.seeds), ()), layer)
        return layer

    def _expand(self, number: int, node: Node, following: List[Tuple[int, Node]]) -> None:
        fair, stats = self.fair[number], self.stats
        lie = lie_in(node, number)
        if lie is not None:
            stats.lies += 1
            told = self._perform(number, node, lie)
            if told is None or self._perform(number, told, ("wait",), lie) is None:
                return
        for move, is_fair in moves_of(node, self.world):
            stats.transitions += 1
            reached = self._perform(number, node, move)
            if reached is None:
                return
            found = self._add(reached, (number, move), following)
            if is_fair:
                fair.append(found)

    def _perform(self, number: int, node: Node, move: Move, *before: Move) -> Optional[Node]:
        """Return what a move leads to from a state of that number; None: it breaks a law."""
        path = (*before, move)
        try:
            reached = perform(node, move, self.world.rules, self._observe)
        except BrokenLawError as broken:
            self.broken = Broken(broken.law, broken.why, (*self.path(number), *path))
            return None
        except Exception as error:  # noqa: BLE001 - whatever it is, it came out of `decide`
            self.broken = Broken("decide_never_fails", repr(error), (*self.path(number), *path))
            return None
        if (
            move[0] == "lie"
            and _ended(node, reached)
            and not _ended(node, perform(node, _true(move), self.world.rules))
        ):
            why = f"one wrong status, and it is {reached.state.state.value}"
            self.broken = Broken("a_lie_ends_nothing", why, (*self.path(number), *path))
            return None
        return reached

    def _settle(self, number: int, node: Node) -> None:
        """Check that LAND and PILOT end when the vehicle comes down, is heard, and the pilot acknowledges."""
        silent = tuple(peer for peer in node.peers.silent if peer not in _UNHEARD)
        node = node._replace(peers=node.peers._replace(vehicle="flying", silent=silent, detection="ON_GROUND"))
        way: List[Move] = [("vehicle", "ground"), *[("wait",)] * _PATIENCE]
        passed: List[Key] = []
        for move in way:
            key = self.key(node.state, node.peers, node.witness, node.old)
            if key in self._settles:
                self._settles.update(passed)
                return
            passed.append(key)
            node = perform(node, move, self.world.rules)
            if node.state.state is State.PILOT:
                node = perform(node, ("user", "acknowledge"), self.world.rules)
            if node.state.state not in (State.LAND, State.PILOT):
                self._settles.update(passed)
                return
        self.broken = Broken(
            "a_landed_vehicle_is_let_go", f"still {node.state.state.value}", (*self.path(number), *way)
        )

    def _add(self, node: Node, origin: Tuple[int, Move], layer: List[Tuple[int, Node]]) -> int:
        key = self.key(node.state, node.peers, node.witness, node.old)
        known = self.index.get(key)
        if known is not None:
            if self.compare and known in self.kept:
                self._compare(known, node, origin)
            return known
        number = len(self.index)
        self.index[key] = number
        self.origin.append(origin)
        self.fair.append([])
        state = node.state
        wrong = sound(state, self.world.rules)
        if wrong and self.broken is None:
            path = (*self.path(origin[0]), origin[1]) if origin[0] >= 0 else self.seeds[-1]
            self.broken = Broken("every_state_is_sound", wrong[0], path)
        down = node.peers.vehicle == "ground" and not {*_UNHEARD} & {*node.peers.silent}
        self.where.append((state.state, state.flight.active, down))
        self.stats.places.add((state.state.value, state.step.value))
        for failure in state.failures:
            self.stats.failures.add((failure.name, failure.action.name.lower()))
        if self.compare and number % _SAMPLE == 0:
            self.kept[number] = node
        layer.append((number, node))
        return number

    def _compare(self, number: int, node: Node, origin: Tuple[int, Move]) -> None:
        """Check that two states of one key have the same future: the same moves lead to the same keys."""
        twin = self.kept[number]
        if twin is None or twin.state is node.state:
            return
        self.kept[number] = None
        self.stats.compared += 1
        ours, theirs = self._futures(node), self._futures(twin)
        if ours != theirs:
            different = sorted(move for move in {**ours, **theirs} if ours.get(move) != theirs.get(move))
            path = (*self.path(origin[0]), origin[1]) if origin[0] >= 0 else ()
            words = f"two states of one key differ after {different[0]}; the other way: {self.path(number)}"
            self.broken = Broken("same_key_same_future", words, path)

    def _futures(self, node: Node) -> Dict[Move, Key]:
        found = {}
        for move, _ in moves_of(node, self.world):
            state, peers, witness, old = perform(node, move, self.world.rules)
            found[move] = self.key(state, peers, witness, old)
        return found

    def path(self, number: int) -> Tuple[Move, ...]:
        """Return the shortest way from boot to a state."""
        moves: List[Move] = []
        while number >= 0:
            number, move = self.origin[number]
            moves.append(move)
        seed = self.seeds[-number - 1]
        return (*seed, *reversed(moves[:-1]))

    def _observer(self) -> Observer:
        check, stats = judge(self.stats.applied), self.stats

        def observe(moment: Any) -> None:
            stats.events += 1
            for command in moment.commands:
                kind = type(command).__name__
                stats.commands[kind] += 1
                stats.words[kind] = (stats.words[kind] + zlib.crc32(repr(command).encode())) & 0xFFFFFFFF
                if type(command) is Decision:
                    stats.rules[command.rule] = stats.rules.get(command.rule, 0) + 1
            check(moment)

        return observe


def _ended(before: Node, after: Node) -> bool:
    """Return True when the care for a vehicle that flies is over: no flight any more, or in somebody else's hands."""
    flew = before.state.flight.active and before.state.state is not State.PILOT
    flies = before.peers.vehicle in ("lifting", "flying", "loitering", "landing")
    return flew and flies and (not after.state.flight.active or after.state.state is State.PILOT)


def _true(lie: Move) -> Move:
    """Return the move in which the same peer says the truth instead, as often."""
    return ("truth", lie[1])


def explore(world: World, limit: Optional[int] = None, *, compare: bool = True) -> Exploration:
    """Return a world, explored; `compare`: check by samples that states of one key have one future."""
    return Exploration(world, compare=compare).run(limit)
