"""Which key asks for what. A key works only while the engine says that its command would be done now.

Two exceptions, for the vehicle may fly by now. LAND goes out in every state: the engine has an answer in each. While
the engine is not heard, what stops the vehicle or brings it down goes out, and nothing else: nobody sees what it does.

Whatever moves the vehicle or ends something for good asks once more, and one key more is always enough: "y", or Enter
where nothing begins to move by it. Holding a key down never says yes: the second key is another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

from amaze_autonomy.engine.events import SAFE, UserCommand

from .model import Snapshot

QUIT_KEY = "q"


@dataclass(frozen=True)
class Binding:
    """One key.

    Args:
        key: the letter, lower case.
        command: what it asks for.
        words: what that does, for the screen.
        question: asked before it is sent; empty: sent at once.
        enter_is_yes: Enter is yes to it, as "y" is.
    """

    key: str
    command: UserCommand
    words: str
    question: str = ""
    enter_is_yes: bool = True


BINDINGS: Tuple[Binding, ...] = (
    Binding("g", UserCommand.GO, "go", "Go: the vehicle takes off. Sure?", enter_is_yes=False),
    Binding("h", UserCommand.HOLD, "hold"),
    Binding(
        "c",
        UserCommand.RESUME,
        "continue (resume)",
        "Resume the mission: the vehicle flies on. Sure?",
        enter_is_yes=False,
    ),
    Binding("l", UserCommand.LAND, "LAND", "LAND at the present position?"),
    Binding("a", UserCommand.ABORT, "ABORT", "ABORT: in the air land, on the ground disarm?"),
    Binding(
        "r",
        UserCommand.RETRY,
        "retry",
        "Retry? Before a flight it takes off as soon as all checks pass: keep clear.",
        enter_is_yes=False,
    ),
    Binding("u", UserCommand.GIVE_UP, "give up", "Give up?"),
    Binding("k", UserCommand.ACKNOWLEDGE, "acknowledge"),
)


def offered(snapshot: Optional[Snapshot], *, heard: bool = True) -> Tuple[Binding, ...]:
    """Return the bindings that are shown now, in the order of the table.

    Args:
        snapshot: the engine's last state; None: never heard of it.
        heard: that is how it is now.
    """
    if snapshot is None or not heard:
        return tuple(binding for binding in BINDINGS if binding.command in SAFE)
    return tuple(binding for binding in BINDINGS if binding.command.value in snapshot.user_commands)


def goes_out(command: UserCommand, snapshot: Optional[Snapshot], *, heard: bool = True) -> bool:
    """Return True when a command is sent to the engine now."""
    return command is UserCommand.LAND or command in [each.command for each in offered(snapshot, heard=heard)]


def binding_of_key(key: str) -> Optional[Binding]:
    """Return the binding of a key, whatever its case."""
    return next((binding for binding in BINDINGS if binding.key == key.lower()), None)


def binding_of_word(word: str) -> Optional[Binding]:
    """Return the binding of a command's name, e.g. "land", "give up" or "give_up"."""
    name = "_".join(word.lower().split())
    return next((binding for binding in BINDINGS if binding.command.value == name), None)
