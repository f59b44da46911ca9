"""Kinds of single values: what a key may be given. A kind reads an entry of a document and says what it takes.

Numbers must be written plainly. YAML 1.1 would read `010` as 8, `1:30` as 90 and `1e3` as a text: each is an error that
says what to write instead.
"""

from __future__ import annotations

import abc
import difflib
import enum
import ipaddress
import math
import re
import termios
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Dict, List, Mapping, NamedTuple, NoReturn, Optional, Tuple

from .document import Entry, Items, Scalar, Table
from .errors import ConfigError, EndpointError, Place

# --- units ------------------------------------------------------------------------------------------------------------
# The unit is the last part of a key: `age_limit_s`. Which units there are, and what one is in another.


# suffix: (what is measured, size in the unit of that, how a number of it is said)
UNITS: Mapping[str, Tuple[str, float, str]] = {
    "s": ("time", 1.0, "in seconds"),
    "ms": ("time", 1e-3, "in milliseconds"),
    "us": ("time", 1e-6, "in microseconds"),
    "ns": ("time", 1e-9, "in nanoseconds"),
    "min": ("time", 60.0, "in minutes"),
    "h": ("time", 3600.0, "in hours"),
    "hz": ("rate", 1.0, "in Hz"),
    "khz": ("rate", 1e3, "in kHz"),
    "m": ("length", 1.0, "in metres"),
    "cm": ("length", 1e-2, "in centimetres"),
    "mm": ("length", 1e-3, "in millimetres"),
    "km": ("length", 1e3, "in kilometres"),
    "ft": ("length", 0.3048, "in feet"),
    "m_s": ("speed", 1.0, "in m/s"),
    "cm_s": ("speed", 1e-2, "in cm/s"),
    "mm_s": ("speed", 1e-3, "in mm/s"),
    "km_h": ("speed", 1 / 3.6, "in km/h"),
    "m_s2": ("acceleration", 1.0, "in m/s^2"),
    "g": ("acceleration", 9.80665, "in g"),
    "deg": ("angle", 1.0, "in degrees"),
    "rad": ("angle", 57.29577951308232, "in radians"),
    "deg_s": ("angular speed", 1.0, "in degrees per second"),
    "rad_s": ("angular speed", 57.29577951308232, "in radians per second"),
    "fraction": ("part", 1.0, "as a fraction of 1"),
    "percent": ("part", 1e-2, "in percent"),
    "v": ("voltage", 1.0, "in volts"),
    "mv": ("voltage", 1e-3, "in millivolts"),
    "bytes": ("size", 1.0, "in bytes"),
    "kb": ("size", 1e3, "in kilobytes"),
    "mb": ("size", 1e6, "in megabytes"),
    "gb": ("size", 1e9, "in gigabytes"),
    "mb_s": ("rate of data", 1e6, "in megabytes per second"),
}


def split_unit(name: str) -> Tuple[str, str]:
    """Split a key into what it means and its unit; the unit is empty when it has none."""
    for suffix in sorted(UNITS, key=len, reverse=True):
        if name.lower().endswith("_" + suffix) and len(name) > len(suffix) + 1:
            return name[: -len(suffix) - 1], suffix
    return name, ""


def unit_words(name: str) -> str:
    """Return the unit of a key as it is said of a number, e.g. "in seconds"; empty when it has none."""
    unit = split_unit(name)[1]
    return UNITS[unit][2] if unit else ""


def converted(value: float, given: str, wanted: str) -> Optional[str]:
    """Say what a value in one unit is in another, e.g. "500 ms are 0.5 s"; None when they measure different things."""
    if given not in UNITS or wanted not in UNITS or UNITS[given][0] != UNITS[wanted][0]:
        return None
    return f"{value:g} {given} are {value * UNITS[given][1] / UNITS[wanted][1]:g} {wanted}"


# --- kinds ------------------------------------------------------------------------------------------------------------


Address = Tuple[str, ...]
Places = Dict[Address, Place]

_PLAIN_INT = re.compile(r"[-+]?(0|[1-9][0-9_]*)")
_PLAIN_FLOAT = re.compile(r"[-+]?[0-9][0-9_]*(\.[0-9_]*)?([eE][-+]?[0-9]+)?|[-+]?\.[0-9]+([eE][-+]?[0-9]+)?")
_SHOWN = 60
_MANY = 20  # more words than a person reads for the one that was meant


def dotted(address: Address) -> str:
    """Return an address as it is written in messages and overrides."""
    return ".".join(address)


def described(entry: Entry) -> str:
    """Say what an entry is, as the first half of an error."""
    if isinstance(entry, Items):
        return "is a list"
    if isinstance(entry, Table):
        return "is a group of keys"
    text = entry.text if isinstance(entry, Scalar) else ""
    shown = text if len(text) <= _SHOWN else text[:_SHOWN] + "..."
    if isinstance(entry, Scalar) and entry.tag == "null":
        return "has no value"
    return f"is the text {shown!r}" if isinstance(entry, Scalar) and entry.tag == "str" else f"is {shown}"


def refuse(entry: Entry, address: Address, wrong: str, right: str) -> NoReturn:
    """Raise the error about an entry."""
    raise ConfigError(entry.place, dotted(address), wrong, right)


class Kind(abc.ABC):
    """What a key may be given."""

    @abc.abstractmethod
    def words(self, unit: str = "") -> str:
        """Say what is taken, after "must be"; `unit` in words."""

    @abc.abstractmethod
    def read(self, entry: Entry, address: Address, places: Places) -> Any:
        """Return the value of an entry as plain Python, and note in `places` where its parts stand.

        Raises:
            ConfigError: it is not of this kind.
        """

    def _refuse(self, entry: Entry, address: Address, wrong: str = "", hint: str = "") -> NoReturn:
        right = "must be " + self.words(unit_words(address[-1]) if address else "")
        refuse(entry, address, wrong or described(entry), right + hint)


@dataclass(frozen=True)
class Number(Kind):
    """A finite number within bounds. `above` and `below` exclude the bound."""

    above: Optional[float] = None
    minimum: Optional[float] = None
    below: Optional[float] = None
    maximum: Optional[float] = None

    def words(self, unit: str = "") -> str:
        """Say which numbers are taken."""
        bounds = (("above", self.above), ("at least", self.minimum), ("below", self.below), ("at most", self.maximum))
        said = " and ".join(f"{word} {bound:g}" for word, bound in bounds if bound is not None)
        return " ".join(part for part in ("a number", said) if part) + (f", {unit}" if unit else "")

    def read(self, entry: Entry, address: Address, places: Places) -> float:
        """Return the number as a float, so that 5 and 5.0 are the same configuration."""
        places[address] = entry.place
        value = self._value(entry, address)
        if not math.isfinite(value):
            self._refuse(entry, address)
        good = (
            (self.above is None or value > self.above)
            and (self.minimum is None or value >= self.minimum)
            and (self.below is None or value < self.below)
            and (self.maximum is None or value <= self.maximum)
        )
        return value + 0.0 if good else self._refuse(entry, address)

    def _value(self, entry: Entry, address: Address) -> float:
        if not isinstance(entry, Scalar) or entry.tag not in ("int", "float", "str"):
            self._refuse(entry, address)
        plain = _PLAIN_INT if entry.tag == "int" else _PLAIN_FLOAT
        if entry.tag == "str":
            self._refuse(entry, address, hint=_how_to_write(entry.text))
        if plain.fullmatch(entry.text) is None:
            self._refuse(entry, address, hint="" if entry.tag == "float" else ", written plainly")
        return float(entry.text.replace("_", ""))


def _how_to_write(text: str) -> str:
    """Say how a number that YAML takes for a text is written; empty when it is no number."""
    if not re.fullmatch(r"\s*" + f"({_PLAIN_FLOAT.pattern})" + r"\s*", text):
        unitless = re.fullmatch(f"({_PLAIN_FLOAT.pattern})" + r"\s*[A-Za-z%/^0-9]+", text)
        return ", written without its unit" if unitless else ""
    value = float(text.replace("_", ""))
    return f": write {value!r} without quotes" if math.isfinite(value) and abs(value) < 1e9 else ""  # noqa: PLR2004


@dataclass(frozen=True)
class Whole(Kind):
    """A whole number within bounds."""

    minimum: int = 0
    maximum: int = 1_000_000

    def words(self, unit: str = "") -> str:
        """Say which whole numbers are taken."""
        return f"a whole number, {self.minimum} to {self.maximum}" + (f", {unit}" if unit else "")

    def read(self, entry: Entry, address: Address, places: Places) -> int:
        """Return the number."""
        places[address] = entry.place
        if not isinstance(entry, Scalar) or entry.tag != "int" or _PLAIN_INT.fullmatch(entry.text) is None:
            self._refuse(entry, address)
        digits = entry.text.replace("_", "")
        if len(digits) > 20 or not self.minimum <= int(digits) <= self.maximum:  # noqa: PLR2004
            self._refuse(entry, address)
        return int(digits)


@dataclass(frozen=True)
class Flag(Kind):
    """True or false."""

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say it."""
        return "true or false"

    def read(self, entry: Entry, address: Address, places: Places) -> bool:
        """Return the flag; `yes` and `on` are taken as YAML 1.1 takes them."""
        places[address] = entry.place
        if not isinstance(entry, Scalar) or entry.tag != "bool":
            self._refuse(entry, address)
        return entry.text.lower() in ("yes", "true", "on")


@dataclass(frozen=True)
class Text(Kind):
    """A text. `numbers`: a number without quotes is taken as the text it is written as.

    Args:
        said: what it is, in words.
        pattern: regular expression that the whole of it matches.
        numbers: see above.
        longest: number of characters.
    """

    said: str = "a text"
    pattern: str = r"[^\x00-\x1f\x7f]+"
    numbers: bool = False
    longest: int = 200

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say what it is."""
        return self.said

    def read(self, entry: Entry, address: Address, places: Places) -> str:
        """Return the text."""
        places[address] = entry.place
        if not isinstance(entry, Scalar) or entry.tag not in (("str", "int", "float") if self.numbers else ("str",)):
            quotes = isinstance(entry, Scalar) and entry.tag != "null"
            self._refuse(entry, address, hint=": put it in quotes" if quotes else "")
        if len(entry.text) > self.longest:
            self._refuse(entry, address, f"has {len(entry.text)} characters", f" of at most {self.longest} characters")
        if re.fullmatch(self.pattern, entry.text) is None or not entry.text.isprintable():
            self._refuse(entry, address)
        return entry.text


_OF_BOTH = r"of . [a-z] [^/] (a|b) * + ? {2} \d \w alone, which rosbag and Python read alike"
_POSIX = re.compile(r"\[:(?=[a-z]+:\])")  # as in [[:alpha:]]


@dataclass(frozen=True)
class Pattern(Text):
    """A regular expression of rosbag's recorder, in C++ (boost), which is read by Python as well."""

    said: str = "a regular expression"
    pattern: str = r"[^\x00-\x1f\x7f ]*"

    def read(self, entry: Entry, address: Address, places: Places) -> str:
        """Return the expression as a text."""
        text = super().read(entry, address, places)
        problem, posix = "", _POSIX.search(text)
        if posix is not None:
            problem = f"{posix[0]} is another thing to Python than to rosbag"
        else:
            try:
                re.compile(text)
            except re.error as error:
                problem = str(error)
        if problem:
            self._refuse(entry, address, f"is the text {text!r} ({problem})", f", {_OF_BOTH}")
        return text


@dataclass(frozen=True)
class Choice(Kind):
    """One of several words."""

    options: Tuple[str, ...]

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say which."""
        return "one of " + ", ".join(self.options)

    def read(self, entry: Entry, address: Address, places: Places) -> str:
        """Return the word."""
        places[address] = entry.place
        if not isinstance(entry, Scalar) or entry.tag != "str" or entry.text not in self.options:
            close = difflib.get_close_matches(getattr(entry, "text", ""), self.options, n=1)
            if close and len(self.options) > _MANY:
                refuse(
                    entry,
                    address,
                    described(entry),
                    f"must be one of {len(self.options)} words; did you mean {close[0]}?",
                )
            self._refuse(entry, address, hint=f"; did you mean {close[0]}?" if close else "")
        return entry.text


@dataclass(frozen=True)
class ListOf(Kind):
    """A list of values of one kind.

    Args:
        kind: of each.
        said: the list in words.
        at_least: so many.
        unique: none twice.
    """

    kind: Kind
    said: str
    at_least: int = 0
    unique: bool = False
    example: str = field(default="")

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say what is in it."""
        size = f", at least {self.at_least}" if self.at_least else ""
        return f"a list of {self.said}{size}" + (f", e.g. {self.example}" if self.example else "")

    def read(self, entry: Entry, address: Address, places: Places) -> List[Any]:
        """Return the values."""
        places[address] = entry.place
        if not isinstance(entry, Items) or len(entry.items) < self.at_least:
            self._refuse(entry, address, "is an empty list" if isinstance(entry, Items) else "")
        values: List[Any] = []
        for position, item in enumerate(entry.items):
            here = (*address, str(position))
            value = self.kind.read(item, here, places)
            if self.unique and value in values:
                refuse(item, here, f"{value!r} is listed twice", "must be listed once")
            values.append(value)
        return values


# --- endpoints --------------------------------------------------------------------------------------------------------
# Connection URLs as MAVLink people write them.
#
# serial:/dev/ttyACM0:921600   a serial device and its baud rate
# udpin:127.0.0.1:14540        wait there for the vehicle, answer where it speaks from (udp: means the same)
# udpout:192.168.1.2:14550     speak there first
# tcp:127.0.0.1:5760           connect there
# tcpin:127.0.0.1:5760         wait there for one peer


_DEFAULT_BAUD = 57600
_LAST_PORT = 65535
_DEVICE = r"/[^\x00-\x20\x7f]*[^\x00-\x20\x7f:/]"
_HOST = r"\[[0-9A-Fa-f:.]+\]|[^\x00-\x20\x7f/\[\]]+"
_FORMS = "serial:DEVICE:BAUD, udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or tcpin:HOST:PORT"
_EVERY_ADDRESS = ("0.0.0.0", "::")  # noqa: S104 - compared, never bound


class EndpointKind(enum.Enum):
    """How bytes reach the peer."""

    SERIAL = "serial"
    UDP_IN = "udpin"
    UDP_OUT = "udpout"
    TCP = "tcp"
    TCP_IN = "tcpin"


_KINDS: Mapping[str, EndpointKind] = {**{kind.value: kind for kind in EndpointKind}, "udp": EndpointKind.UDP_IN}
_OWNED = (EndpointKind.SERIAL, EndpointKind.UDP_IN, EndpointKind.TCP_IN)  # what one process alone can have


class Endpoint(NamedTuple):
    """Where the other end of a link is.

    Args:
        kind: how bytes reach it.
        address: host or device.
        number: port or baud rate.
    """

    kind: EndpointKind
    address: str
    number: int

    def __str__(self) -> str:
        return f"{self.kind.value}:{self.address}:{self.number}"

    def excludes(self, other: Endpoint) -> bool:
        """Return whether two processes cannot have both at once, however they are written; names are not looked up."""
        if self.kind is not other.kind or self.kind not in _OWNED:
            return False
        if self.kind is EndpointKind.SERIAL:
            return re.sub("/+", "/", self.address) == re.sub("/+", "/", other.address)
        addresses = {_numeric(self.address), _numeric(other.address)}
        return self.number == other.number and (len(addresses) == 1 or not addresses.isdisjoint(_EVERY_ADDRESS))


def _numeric(host: str) -> str:
    """Return an address in its shortest form; a name as it is."""
    host = "127.0.0.1" if host.lower() == "localhost" else host.lower()
    with suppress(ValueError):
        host = str(ipaddress.ip_address(host))
    return host


def parse_endpoint(url: str) -> Endpoint:
    """Return what a connection URL names.

    Raises:
        EndpointError: It is none, or names a baud rate that this system does not have.
    """
    found = re.fullmatch(r"([a-z]+):(?://)?(.+)", url.strip())
    if found is None or found.group(1) not in _KINDS:
        raise EndpointError(repr(url), "is no connection URL", f"must be {_FORMS}")
    kind, rest = _KINDS[found.group(1)], found.group(2)
    if kind is EndpointKind.SERIAL:
        return _serial(url, rest)
    address, _, number = rest.rpartition(":")
    port = int(number) if number.isascii() and number.isdecimal() else 0
    if re.fullmatch(_HOST, address) is None or not 0 < port <= _LAST_PORT:
        raise EndpointError(repr(url), "names no host and port", f"must be {kind.value}:HOST:PORT, PORT 1 to 65535")
    return Endpoint(kind, address.strip("[]"), port)


def _serial(url: str, rest: str) -> Endpoint:
    """Return a device and its baud rate; the stable names of /dev/serial/by-path have colons in them themselves."""
    device, colon, tail = rest.rpartition(":")
    has_baud = tail.isascii() and tail.isdecimal()
    if not colon or (not has_baud and re.match(r"[0-9]", tail)):
        device, tail, has_baud = rest, str(_DEFAULT_BAUD), True
    if not re.fullmatch(_DEVICE, device) or not has_baud or not int(tail):
        raise EndpointError(repr(url), "names no device and baud rate", "must be serial:/dev/ttyACM0:921600 or alike")
    if not hasattr(termios, f"B{int(tail)}"):
        right = "must be one that this system has; 57600, 115200 and 921600 are usual"
        raise EndpointError(repr(url), "names no baud rate of this system", right)
    return Endpoint(EndpointKind.SERIAL, device, int(tail))


@dataclass(frozen=True)
class Url(Text):
    """A connection URL."""

    said: str = 'a connection URL, e.g. "udpin:127.0.0.1:14540" or "serial:/dev/ttyACM0:921600"'
    pattern: str = r"[^\x00-\x20\x7f]+"

    def read(self, entry: Entry, address: Address, places: Places) -> str:
        """Return the URL as a text."""
        text = super().read(entry, address, places)
        try:
            parse_endpoint(text)
        except EndpointError as error:
            refuse(entry, address, f"is the text {text!r}, which {error.wrong}", error.right)
        return text
