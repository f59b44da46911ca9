"""What the vehicle says in words: chunks put together, tabs cut off, the same text once.

PX4 ends its texts with a tab when the same comes as an EVENT, of which those that say why it does not arm are taken.
Long texts come in chunks of 50 characters that share an id. https://mavlink.io/en/messages/common.html#STATUSTEXT
"""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

from ..link.dialect import mavlink

_S = 1_000_000_000
_CHUNK = 50
_CHUNK_LIMIT_NS = 2 * _S
_REPEAT_NS = 2 * _S
_KEPT = 32
_LONGEST_CHUNKS = 8
_COMPLAINT = mavlink.MAV_SEVERITY_WARNING
_PREARM = ("prearm", "preflight", "arming denied", "arm:")


class Text(NamedTuple):
    """One text: when it came last, how severe (0 emergency to 7 debug), what."""

    t_ns: int
    severity: int
    text: str


class _Chunks:
    """A text that is not complete."""

    def __init__(self, t_ns: int, severity: int) -> None:
        self.t_ns, self.severity = t_ns, severity
        self.parts: Dict[int, str] = {}


class Texts:
    """The last texts of a vehicle."""

    def __init__(self) -> None:
        self._texts: List[Text] = []
        self._chunks: Optional[Tuple[int, _Chunks]] = None
        self.new: List[Text] = []

    def add(self, t_ns: int, message: Any) -> None:
        """Take a STATUSTEXT; complete new texts go to `new`, which the owner empties."""
        if self._chunks is not None and self._chunks[0] != message.id:
            self.flush()
        if not message.id:
            self._complete(t_ns, int(message.severity), message.text)
            return
        if self._chunks is None:
            self._chunks = (message.id, _Chunks(t_ns, int(message.severity)))
        parts = self._chunks[1].parts
        if message.chunk_seq < _LONGEST_CHUNKS:
            parts[message.chunk_seq] = message.text
        if len(message.text) < _CHUNK and len(parts) == message.chunk_seq + 1:
            self.flush()

    def add_event(self, t_ns: int, message: Any) -> None:
        """Take an EVENT: PX4 tells it also where it withholds its texts."""
        event = event_of(message)
        if event is not None:
            self._complete(t_ns, event.severity, event.words)

    def wake(self, t_ns: int) -> None:
        """Give up the rest of a text whose last chunk is lost."""
        if self._chunks is not None and t_ns - self._chunks[1].t_ns > _CHUNK_LIMIT_NS:
            self.flush()

    def flush(self) -> None:
        """Take what there is of a text in chunks; what is missing is shown as [...]."""
        if self._chunks is None:
            return
        (_, chunks), self._chunks = self._chunks, None
        wanted = range(max(chunks.parts, default=-1) + 1)
        said = "".join(chunks.parts.get(number, "[...]") for number in wanted)
        self._complete(chunks.t_ns, chunks.severity, said)

    def _complete(self, t_ns: int, severity: int, said: str) -> None:
        said = "".join(letter if letter.isprintable() else " " for letter in said).strip()
        if not said:
            return
        before = next((text for text in self._texts if (text.severity, text.text) == (severity, said)), None)
        text = Text(t_ns, severity, said)
        if before is not None:
            self._texts.remove(before)
        if before is None or t_ns - before.t_ns > _REPEAT_NS:
            self.new.append(text)
        self._texts = [*self._texts, text][-_KEPT:]
        self.new = self.new[-_KEPT:]

    def recent(self, t_ns: int, within_ns: int) -> Tuple[Text, ...]:
        """Return the texts of the last while, the newest last."""
        return tuple(text for text in self._texts if 0 <= t_ns - text.t_ns <= within_ns)

    def complaints(self, t_ns: int, within_ns: int) -> Tuple[str, ...]:
        """Return what the vehicle gave as reasons not to arm."""
        return tuple(
            text.text
            for text in self.recent(t_ns, within_ns)
            if text.severity <= _COMPLAINT and text.text.lower().startswith(_PREARM)
        )


# --- px4 events -------------------------------------------------------------------------------------------------------
# PX4's EVENTs that say why it does not arm, in words: they come on every link, unlike its texts.
#
# An event has no words, but the hash of its name: 24 bits of FNV-1a, below the id of its component. The words are
# those of PX4's own texts, so that what comes both ways is said once. https://mavlink.io/en/services/events.html


_ID_BITS = 0xFFFFFF
_OURS = 1 << 3 | 1 << 4  # navigation states AUTO.MISSION and AUTO.LOITER, in which we arm
_CHECK = "check_"

_WORDS: Mapping[str, str] = {
    "commander_arm_denied_resolve_failures": "Arming denied: Resolve system health failures first",
    "commander_arm_denied_throttle_high": "Arming denied: throttle above center",
    "commander_arm_denied_not_manual": "Arming denied: switch to manual mode first",
    "check_estimator_gps_fix_too_low": "Preflight: GPS fix too low",
    "check_modes_local_pos": "Preflight: no valid local position estimate",
    "check_modes_global_pos": "Preflight: no valid global position estimate",
}


class Event(NamedTuple):
    """How severe (0 emergency to 7 debug), and what."""

    severity: int
    words: str


def event_id(name: str) -> int:
    """Return the id of an event of this name, without its component."""
    value = 0x811C9DC5
    for byte in name.encode("ascii"):
        value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
    return value & _ID_BITS


_BY_ID = {event_id(name): name for name in _WORDS}


def event_of(message: Any) -> Optional[Event]:
    """Return what an EVENT says; None: nothing about arming in the modes that we arm in."""
    name = _BY_ID.get(message.id & _ID_BITS)
    if name is None:
        return None
    modes = int.from_bytes(bytes(message.arguments[:4]), "little")
    if name.startswith(_CHECK) and not modes & _OURS:
        return None
    return Event(message.log_levels & 0xF, _WORDS[name])
