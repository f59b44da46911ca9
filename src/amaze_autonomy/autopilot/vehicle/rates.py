"""Asks for the messages that we need, and again for what does not come: ArduPilot streams nothing unasked.

No acknowledgement is looked at. A message that comes at less than a third of its rate is asked for again every 3 s, and
after some attempts every 30 s: not every autopilot grants every rate. PX4 beats at 1 Hz, whatever it is asked, and
refuses to be asked; it sends a CURRENT_MODE that was asked for at 10 Hz with each change, and else twice a second.
"""

from __future__ import annotations

from typing import Dict, List, Mapping, Tuple

from ..link.dialect import Message, mavlink, message_id

__all__ = ["Rates"]

_S = 1_000_000_000
_AGAIN_NS = 3 * _S
_SLOW_AGAIN_NS = 30 * _S
_QUICK_ATTEMPTS = 5
_PERIODS = 3
_AT_ONCE = 4
_ON_CHANGE_NS = {"CURRENT_MODE": 3 * _S // 2}  # longest pause of what comes with each change, once it was asked for


class _Wanted:
    def __init__(self, name: str, rate_hz: float) -> None:
        self.number, self.interval_ns = message_id(name), round(_S / rate_hz)
        self.pause_ns = _ON_CHANGE_NS.get(name, _PERIODS * self.interval_ns)
        self.must_be_asked = name in _ON_CHANGE_NS
        self.heard_ns = self.due_ns = self.attempts = 0


class Rates:
    """The messages that are wanted.

    Args:
        rates_hz: rate by name of the message.
    """

    def __init__(self, rates_hz: Mapping[str, float]) -> None:
        self._wanted: Dict[str, _Wanted] = {name: _Wanted(name, rate) for name, rate in rates_hz.items()}

    def heard(self, t_ns: int, name: str) -> None:
        """Note that a message came."""
        wanted = self._wanted.get(name)
        if wanted is not None:
            wanted.heard_ns = t_ns

    def wake(self, t_ns: int, system: int, component: int, without: Tuple[str, ...] = ()) -> List[Message]:
        """Return the requests that are due; messages in `without` this autopilot does not have."""
        wanted = [one for name, one in self._wanted.items() if name not in without]
        due = [one for one in wanted if t_ns >= one.due_ns and not self._comes(t_ns, one)]
        for one in due[:_AT_ONCE]:
            one.attempts += 1
            one.due_ns = t_ns + (_AGAIN_NS if one.attempts < _QUICK_ATTEMPTS else _SLOW_AGAIN_NS)
        return [
            mavlink.MAVLink_command_long_message(
                system,
                component,
                mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
                0,
                one.number,
                one.interval_ns / 1000,
                0,
                0,
                0,
                0,
                0,
            )
            for one in due[:_AT_ONCE]
        ]

    def forget(self) -> None:
        """Ask for all of them again: the autopilot has started again."""
        for one in self._wanted.values():
            one.due_ns = one.heard_ns = one.attempts = 0

    @staticmethod
    def _comes(t_ns: int, one: _Wanted) -> bool:
        if one.must_be_asked and not one.attempts:
            return False
        return one.heard_ns > 0 and t_ns - one.heard_ns <= one.pause_ns
