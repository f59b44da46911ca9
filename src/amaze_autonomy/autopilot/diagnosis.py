"""What is wrong with a link, in words for whoever has to put it right. Pure; the first row that fits counts."""

from __future__ import annotations

from typing import Callable, Optional, Sequence, Tuple

from .connection import LinkState

__all__ = ["link_problem", "strangers_problem"]

_NOISE_BYTES = 1000
_DOUBLES = 3


def strangers_problem(vehicle: Optional[int], strangers: Sequence[str]) -> str:
    """Return what is wrong with a second vehicle of our system id, which is not listened to."""
    where = ", ".join(strangers)
    return f"another vehicle says system id {vehicle}, from {where}; it is ignored: give it another MAV_SYS_ID or port"


_Row = Tuple[Callable[[LinkState], bool], Callable[[LinkState], str]]
_ROWS: Tuple[_Row, ...] = (
    (lambda state: bool(state.problem), lambda state: state.problem),
    (
        lambda state: state.heartbeat_ns is None and state.refused > 0,
        lambda _: "no message has a good signature: the vehicle has another key, or none",
    ),
    (
        lambda state: state.heartbeat_ns is None and bool(state.others),
        lambda state: f"no vehicle {state.vehicle}; heard are {', '.join(map(str, state.others))}: see vehicle_id",
    ),
    (
        lambda state: state.heartbeat_ns is None and state.frames == 0 and state.damaged_bytes > _NOISE_BYTES,
        lambda _: "only noise is heard: is the baud rate right, does MAVLink come from there?",
    ),
    (lambda state: state.heartbeat_ns is None, lambda _: "no vehicle heard yet"),
    (lambda state: bool(state.strangers), lambda state: strangers_problem(state.vehicle, state.strangers)),
    (
        lambda state: state.doubles >= _DOUBLES,
        lambda _: "somebody else speaks with our own system and component id: give one another component_id",
    ),
    (lambda state: state.errors > 0, lambda _: "a message could not be dealt with: see the log"),
)


def link_problem(state: LinkState) -> str:
    """Return what is wrong; empty: nothing."""
    return next((words(state) for fits, words in _ROWS if fits(state)), "")
