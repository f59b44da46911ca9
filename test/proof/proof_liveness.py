"""Liveness: from every state, when peers answer or their limits pass, the engine comes to rest.

A loop without progress is a cycle over moves that cannot be withheld for ever: time, and answers to what was asked.
Only where a person is waited for may time go round, and while a vehicle that is told to land is not down. In the worlds
without a limit of flight time a flight goes on as well; with it (world `limits`) it does not.
"""

from __future__ import annotations

from typing import Dict, List, Tuple

from proof_explorer import Exploration
from proof_peers import NEVER

from amaze_autonomy.engine.state import State

_RESTS = (State.MISSION_INPUT, State.OUTREACH, State.PILOT, State.MISSION_ENDED)


def loops(exploration: Exploration) -> List[int]:
    """Return a state of each loop without progress."""
    endless = exploration.world.rules.limits.max_flight_time_ns >= NEVER

    def rests(number: int) -> bool:
        state, in_flight, down = exploration.where[number]
        flies = state is State.MISSION and in_flight and endless
        return state in _RESTS or flies or (state is State.LAND and not down)

    return sorted(min(m) for m in _components(exploration.fair) if not all(map(rests, m)))


def _components(edges: List[List[int]]) -> List[List[int]]:
    """Return the strongly connected components that have a cycle (Tarjan's algorithm, without recursion)."""
    order: Dict[int, int] = {}
    low: Dict[int, int] = {}
    stack: List[int] = []
    on_stack = set()
    found: List[List[int]] = []
    for root in range(len(edges)):
        if root in order:
            continue
        work: List[Tuple[int, int]] = [(root, 0)]
        while work:
            node, at = work.pop()
            if at == 0:
                order[node] = low[node] = len(order)
                stack.append(node)
                on_stack.add(node)
            for position in range(at, len(edges[node])):
                following = edges[node][position]
                if following not in order:
                    work += [(node, position + 1), (following, 0)]
                    break
                if following in on_stack:
                    low[node] = min(low[node], order[following])
            else:
                if low[node] == order[node]:
                    _close(node, edges, stack, on_stack, found)
                if work:
                    parent = work[-1][0]
                    low[parent] = min(low[parent], low[node])
    return found


def _close(node: int, edges: List[List[int]], stack: List[int], on_stack: set[int], found: List[List[int]]) -> None:
    members = []
    while True:
        member = stack.pop()
        on_stack.discard(member)
        members.append(member)
        if member == node:
            break
    if len(members) > 1 or node in edges[node]:
        found.append(members)
