"""What every feed does: it takes the messages of a topic, one by one or many at once, and can play it as nominal."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from functools import partial
from math import inf, isfinite, nan, sqrt
from typing import Any, Callable, Container, Dict, FrozenSet, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.autopilot.vehicle.modes import ARDUPILOT_NAMES
from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.interface import health_of
from amaze_autonomy.monitoring.battery import BatteryMonitor
from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.gravity import (
    BUCKET_NS,
    PLAUSIBLE_M2_S4,
    Quaternion,
    rotation_from_rpy,
    tilt_of,
    up_of_quaternion,
)
from amaze_autonomy.monitoring.landing import LandingDetector, seen_m
from amaze_autonomy.monitoring.readings import estimate_reader
from amaze_autonomy.monitoring.specs import AutopilotSensor, EstimateSource
from amaze_autonomy.monitoring.state_estimation import Estimate, StateEstimationMonitor
from amaze_autonomy.monitoring.watchdog import Watchdog

from ..errors import FieldError
from ..maps.topic_map import Reading
from ..recordings.fields import Getter, Track, getter, number, orientation, quaternion, vector
from .monitor_columns import LandingColumns, RateColumns


class Rise(NamedTuple):
    """How a scripted vehicle comes to where the recorded one is first.

    Args:
        share: what of the way is still to come at a time, 1 to 0; 0 on the ground, where it is there already.
        height_m: how far it is below the first recorded height at a time.
    """

    share: Callable[[int], float]
    height_m: Callable[[int], float]


class Feed:
    """One use of a topic.

    Args:
        topic: that it takes.
        period_ns: of its messages, for playing it.
        decodes: it looks into the messages.
        paths: of the numbers in them that it looks at; empty: it needs whole messages.
    """

    def __init__(self, topic: str, period_ns: int, *, decodes: bool = True, paths: Tuple[str, ...] = ()) -> None:
        self.topic, self.period_ns, self.decodes, self.paths = topic, period_ns, decodes, paths

    def take(self, t_ns: int, message: Any) -> None:
        """Take a message; `message` is None when the feed does not decode."""
        raise NotImplementedError

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take the numbers at `paths` of a message; does what `take` does with all of it."""
        raise NotImplementedError

    def play(self, t_ns: int) -> None:
        """Take what a good message would have said at a time."""

    def join(self, message: Any, rise: Rise) -> None:
        """Lead up to the first recorded message without a jump; `rise` tells where the scripted vehicle is before."""

    # --- many at once -------------------------------------------------------------------------------------------------

    def ride(self, track: Track, rank: int) -> None:
        """Take all messages from a track from now on, when somebody asks; `rank` is that of the topic."""
        self.track, self.rank, self.taken = track, rank, 0

    def until(self, now: Tuple[int, int]) -> None:
        """Take all messages of the track before a time and rank, as if they had come one after the other."""
        listed, begin = self.track.listed, self.taken
        if begin < len(listed) and listed[begin] <= now[0]:
            end = (bisect_right if self.rank < now[1] else bisect_left)(listed, now[0], begin)
            self.taken = max(begin, end)
            self.take_many(begin, self.taken)

    def take_many(self, begin: int, end: int) -> None:
        """Take messages of the track by their places; does what `take_values` does with each of them."""
        for t_ns, values in zip(self.track.listed[begin:end], self.track.rows(begin, end)):
            self.take_values(t_ns, values)


class LastCounts(Feed):
    """A use of a topic for which the last message is all that counts."""

    def take_many(self, begin: int, end: int) -> None:
        """Take the last one."""
        super().take_many(max(begin, end - 1), end)


# --- fact feeds -------------------------------------------------------------------------------------------------------
# From messages to what the vehicle is known to be: its battery, whether it is armed or landed, its height.


_S = 1_000_000_000
FULL = 0.95
MISSION_MODE = "AUTO.MISSION"


@dataclass(frozen=True)
class Fact:
    """The last thing that the recording said about one property of the vehicle."""

    t_ns: int
    value: Any


class BatteryFeed(LastCounts):
    """The battery: for its check, and for what the vehicle says."""

    def __init__(self, monitor: BatteryMonitor, reading: Reading, facts: Dict[str, Fact]) -> None:
        super().__init__(reading.topic, _S // 2, paths=tuple(reading.fields.values()))
        self._monitor, self._facts, self._scale = monitor, facts, reading.scale
        self._get: Mapping[str, Getter] = {name: getter(path) for name, path in reading.fields.items()}
        self._first: Optional[Tuple[float, Optional[float]]] = None
        self._rise: Optional[Rise] = None

    def take(self, t_ns: int, message: Any) -> None:
        """Take a level."""
        self.take_values(t_ns, tuple(get(message) for get in self._get.values()))

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take fraction and voltage, as far as there are any."""
        self._take(t_ns, dict(zip(self._get, map(number, values))))

    def _take(self, t_ns: int, values: Mapping[str, Optional[float]]) -> None:
        fraction = values.get("fraction")
        fraction = None if fraction is None else fraction * self._scale
        self._monitor.add(t_ns, fraction, values.get("voltage"))
        self._facts["battery_fraction"] = Fact(t_ns, fraction)
        if "voltage" in values:
            self._facts["battery_voltage_v"] = Fact(t_ns, values["voltage"])

    def play(self, t_ns: int) -> None:
        """Take a charged battery."""
        if self._first is not None:
            self._monitor.add(t_ns, self.level_at(t_ns), self._first[1])
            return
        spec = self._monitor.spec
        self._monitor.add(t_ns, FULL, 0.5 * (spec.cell_voltage_min_v + spec.cell_voltage_max_v) * (spec.cells or 4))

    def join(self, message: Any, rise: Rise) -> None:
        """Play what is recorded first, on the ground; before a flight in the air a full battery that drains to it."""
        values = {name: number(get(message)) for name, get in self._get.items()}
        fraction = values.get("fraction")
        if fraction is not None and 0.0 <= fraction * self._scale <= 1.0:
            self._first, self._rise = (fraction * self._scale, values.get("voltage")), rise

    def level_at(self, t_ns: int) -> float:
        """Return the level that is played at a time."""
        if self._first is None or self._rise is None:
            return FULL
        return self._first[0] + (max(FULL, self._first[0]) - self._first[0]) * self._rise.share(t_ns)


class FactFeed(LastCounts):
    """A property of the vehicle, one of `FACTS`."""

    def __init__(self, name: str, reading: Reading, facts: Dict[str, Fact]) -> None:
        super().__init__(
            reading.topic, 0, paths=() if name == "mode" else (reading.fields[name],)
        )  # words are no numbers
        self._name, self._facts = name, facts
        self._get = getter(reading.fields[name])
        self._read = _READ[name](reading)

    def take(self, t_ns: int, message: Any) -> None:
        """Keep it."""
        self.take_values(t_ns, (self._get(message),))

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Keep it."""
        self._facts[_FACTS[self._name]] = Fact(t_ns, self._read(values[0]))


def _height(reading: Reading) -> Callable[[Any], Optional[float]]:
    def read(value: Any) -> Optional[float]:
        metres = number(value)
        return None if metres is None else metres * reading.scale + reading.offset

    return read


def _landed(reading: Reading) -> Callable[[Any], VehicleLanded]:
    unknown, on_ground = map(_meanings, (reading.unknown, reading.on_ground))

    def read(value: Any) -> VehicleLanded:
        meaning = _meaning(value)
        if meaning in unknown:
            return VehicleLanded.UNKNOWN
        return VehicleLanded.ON_GROUND if meaning in on_ground else VehicleLanded.IN_AIR

    return read


def _mode(reading: Reading) -> Callable[[Any], str]:
    def read(value: Any) -> str:
        word = _word(value)
        return MISSION_MODE if word in reading.mission else ARDUPILOT_NAMES.get(word, word)

    return read


def _failsafe(reading: Reading) -> Callable[[Any], bool]:
    on = _meanings(reading.on)
    return lambda value: _meaning(value) in on


def _armed(_: Reading) -> Callable[[Any], bool]:
    return bool


def _meanings(words: Tuple[str, ...]) -> FrozenSet[str]:
    return frozenset(map(_meaning, words))


def _meaning(value: Any) -> str:
    """Return a value as words of a map are compared with it: true, True and 1 mean the same, as false and 0."""
    word = _word(value)
    return {"true": "1", "false": "0"}.get(word.lower(), word)


def _word(value: Any) -> str:
    return str(value.item() if hasattr(value, "item") else value)


_READ: Mapping[str, Callable[[Reading], Callable[[Any], Any]]] = {
    "height": _height,
    "landed": _landed,
    "armed": _armed,
    "mode": _mode,
    "failsafe": _failsafe,
}
_FACTS: Mapping[str, str] = {**{name: name for name in _READ}, "height": "height_m"}
FACTS = tuple(_READ)


# --- ground feeds -----------------------------------------------------------------------------------------------------
# From messages to the landing detection: distances to the ground, and how far the vehicle is tilted.


class RangeFeed(Feed):
    """A distance to the ground, in the units of the message; the specification scales it.

    Args:
        detector: that takes it.
        reading: of the map.
        given: limits that the map says: they win over those in the messages.
    """

    def __init__(self, detector: LandingDetector, reading: Reading, given: Container[str] = ()) -> None:
        super().__init__(reading.topic, _S // 20, paths=(reading.fields["distance"], "min_range", "max_range"))
        self._detector, self._get = detector, getter(reading.fields["distance"])
        self._unsaid = "min_range_m" in given, "max_range_m" in given
        self.tilt: Optional[TiltFeed] = None
        self._first_m: Optional[float] = None
        self._below: Callable[[int], float] = lambda _: 0.0
        self._landing_columns: Optional[LandingColumns] = None

    def ride(self, track: Track, rank: int) -> None:
        """Take all readings of a track, with the limits that count."""
        reading, *limits = track.columns
        nothing = np.full(len(track), nan)
        told = (nothing if unsaid else limit for limit, unsaid in zip(limits, self._unsaid))
        super().ride(Track(track.times, (reading, *told)) if any(self._unsaid) else track, rank)

    def take_many(self, begin: int, end: int) -> None:
        """Take readings of the track, each with the tilt of its time."""
        if self.tilt is None:
            self._take_level(begin, end)
            return
        for place in range(begin, end):
            self.tilt.until((self.track.listed[place], self.rank))
            super().take_many(place, place + 1)

    def _take_level(self, begin: int, end: int) -> None:
        if self._landing_columns is None:
            self._landing_columns = LandingColumns(self._detector, self.track)
        while begin < end:
            taken = self._landing_columns.skipped(begin, end)
            if taken == begin:
                taken += 1
                super().take_many(begin, taken)
            begin = taken

    def take(self, t_ns: int, message: Any) -> None:
        """Take a reading; what is no number is nothing seen."""
        limits = getattr(message, "min_range", None), getattr(message, "max_range", None)
        self.take_values(t_ns, (self._get(message), *limits))

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take a reading and its limits."""
        value = number(values[0])
        self._detector.add_range(t_ns, nan if value is None else value, *self._limits(values[1:]))

    def _limits(self, told: Sequence[Any]) -> List[Optional[float]]:
        """Return what a message says of its limits, where the map does not."""
        return [None if unsaid else number(limit) for limit, unsaid in zip(told, self._unsaid)]

    def play(self, t_ns: int) -> None:
        """Take what the sensor measures when the vehicle stands on the ground."""
        spec = self._detector.spec
        on_ground_m = max(spec.mounting_height_m, spec.min_range_m)
        distance_m = on_ground_m if self._first_m is None else max(on_ground_m, self._first_m - self._below(t_ns))
        self._detector.add_range(t_ns, distance_m / spec.scale)

    def join(self, message: Any, rise: Rise) -> None:
        """Play the height of the scripted vehicle, to what is recorded first."""
        spec = self._detector.spec
        limits = self._limits([getattr(message, name, None) for name in ("min_range", "max_range")])
        value = number(self._get(message))
        self._first_m = None if value is None else seen_m(value, spec, *limits)
        self._below = rise.height_m


class TiltFeed(Feed):
    """The attitude of the vehicle for the landing detection; an invalid orientation says nothing."""

    def __init__(self, detector: LandingDetector, reading: Reading) -> None:
        path = reading.fields["orientation"]
        super().__init__(reading.topic, 0, paths=tuple(f"{path}.{axis}" for axis in "xyzw"))
        self._detector, self._get = detector, getter(path)

    def take(self, t_ns: int, message: Any) -> None:
        """Take an orientation."""
        self._take(t_ns, quaternion(self._get(message)))

    def take_many(self, begin: int, end: int) -> None:
        """Take the last one that says something."""
        for place in range(end - 1, begin - 1, -1):
            x, y, z, w = map(float, self.track.rows(place, place + 1)[0])
            parts = orientation((x, y, z, w))
            if parts is not None and isfinite(self._tilt(parts)):
                self._take(self.track.listed[place], parts)
                return

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take its four numbers."""
        x, y, z, w = map(float, values)
        self._take(t_ns, orientation((x, y, z, w)))

    def _take(self, t_ns: int, parts: Optional[Tuple[float, float, float, float]]) -> None:
        if parts is not None:
            self._detector.add_tilt(t_ns, self._tilt(parts))

    @staticmethod
    def _tilt(parts: Tuple[float, float, float, float]) -> float:
        up = up_of_quaternion(*parts)
        return nan if up is None else tilt_of(up)  # NaN is not taken


# --- state feeds ------------------------------------------------------------------------------------------------------
# From messages to the check of the states: samples of an accelerometer, and estimates.


Vector = Tuple[float, float, float]

_SURE: Vector = (1e-4, 1e-4, 1e-4)
_STAMP = ("header.stamp.sec", "header.stamp.nanosec")
_POSE = (*(f"position.{axis}" for axis in "xyz"), *(f"orientation.{axis}" for axis in "xyzw"))
_WITH_COVARIANCE = (
    *_STAMP,
    *(f"pose.pose.{each}" for each in _POSE),
    *(f"pose.covariance[{7 * axis}]" for axis in range(6)),
)
_ESTIMATE: Mapping[EstimateSource, Tuple[str, ...]] = {
    EstimateSource.POSE: (*_STAMP, *(f"pose.{each}" for each in _POSE)),
    EstimateSource.POSE_WITH_COVARIANCE: _WITH_COVARIANCE,
    EstimateSource.ODOMETRY: (*_WITH_COVARIANCE, *(f"twist.twist.linear.{axis}" for axis in "xyz")),
}


def _covariance_of(turn_rate: str) -> str:
    """Return the path of what tells whether there is a gyroscope; empty: nothing does.

    A covariance that begins with -1 says that there is no such measurement (sensor_msgs/Imu), as to the live node.
    """
    return f"{turn_rate}_covariance[0]" if turn_rate.rpartition(".")[2] == "angular_velocity" else ""


class ImuFeed(Feed):
    """An accelerometer in the vehicle, for the check of gravity."""

    def __init__(self, monitor: StateEstimationMonitor, reading: Reading) -> None:
        rpy, g = monitor.spec.imu_mounting_rpy_rad, monitor.spec.gravity_m_s2
        vectors = [reading.fields[name] for name in ("acceleration", "turn_rate") if name in reading.fields]
        covariance = _covariance_of(reading.fields.get("turn_rate", ""))
        paths = [f"{path}.{axis}" for path in vectors for axis in "xyz"]
        super().__init__(reading.topic, _S // 50, paths=(*paths, covariance) if covariance else tuple(paths))
        self._covariance = getter(covariance) if covariance else None
        self._window, self._add, self.scale = monitor.imu, monitor.add_imu, reading.scale
        self._acceleration = getter(reading.fields["acceleration"])
        self._turn_rate = getter(reading.fields["turn_rate"]) if "turn_rate" in reading.fields else None
        column = rotation_from_rpy(rpy)[2]  # up in the sensor's frame: the transposed matrix times (0, 0, 1)
        self._level: Vector = (column[0] * g, column[1] * g, column[2] * g)

    def take(self, t_ns: int, message: Any) -> None:
        """Take a sample."""
        x, y, z = vector(self._acceleration(message))
        scale = self.scale
        turn_rate = None
        if self._turn_rate is not None and self._measured(message):
            turn_rate = vector(self._turn_rate(message))
        self._add(t_ns, (x * scale, y * scale, z * scale), turn_rate)

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take the three numbers of the acceleration, and of the turn rate with its covariance where it has one."""
        if type(values[0]) is not float or type(values[-1]) is not float:  # an odd message with whole numbers
            values = tuple(map(float, values))
        scale = self.scale
        turn_rate = values[3:6] if self._covariance is None or values[6] >= 0 else None
        self._add(t_ns, (values[0] * scale, values[1] * scale, values[2] * scale), turn_rate or None)

    def _measured(self, message: Any) -> bool:
        """Return whether a message says nothing against its turn rate; a type without a covariance does not."""
        try:
            return self._covariance is None or bool(self._covariance(message) >= 0)
        except FieldError:
            return True

    def take_many(self, begin: int, end: int) -> None:
        """Take samples of the track; of those that are too old to be kept, when they came."""
        times = self.track.times
        oldest_ns = (int(times[end - 1]) - self._window.span_ns) // BUCKET_NS * BUCKET_NS
        first = min(end, max(begin, int(np.searchsorted(times, oldest_ns))))
        if first > begin:
            x, y, z = (column[begin:first].astype(float) * self.scale for column in self.track.columns[:3])
            with np.errstate(over="ignore", invalid="ignore"):
                good = x * x + y * y + z * z < PLAUSIBLE_M2_S4
            self._window.skip(times[begin:first][good].tolist())
        super().take_many(first, end)

    def play(self, t_ns: int) -> None:
        """Take what a vehicle measures that stands level and still."""
        self._add(t_ns, self._level, (0.0, 0.0, 0.0))


class EstimateFeed(Feed):
    """An estimate of the state, for its check."""

    def __init__(self, monitor: StateEstimationMonitor, reading: Reading) -> None:
        super().__init__(reading.topic, round(_S / monitor.spec.rate_hz), paths=_ESTIMATE[monitor.spec.source])
        self._monitor = monitor
        self._read = estimate_reader(monitor.spec.source)
        self._rate_columns: Optional[RateColumns] = None
        self._first: Vector = (0.0, 0.0, 0.0)
        self._heading: Quaternion = (0.0, 0.0, 0.0, 1.0)
        self._below: Callable[[int], float] = lambda _: 0.0

    def ride(self, track: Track, rank: int) -> None:
        """Take all estimates of a track."""
        super().ride(track, rank)
        if self._monitor.rate is not None:
            self._rate_columns = RateColumns(self._monitor.rate, track, self._monitor.rate.add)

    def take_many(self, begin: int, end: int) -> None:
        """Take estimates of the track: the last one, and where the others were."""
        if self._rate_columns is not None:
            self._rate_columns.take(begin, end)
        for place, t_ns in enumerate(self.track.listed[begin : end - 1], begin):
            self._monitor.trace(t_ns, partial(self._pose, place))
        self._monitor.keep_estimate(self.track.listed[end - 1], *self._estimate(self.track.rows(end - 1, end)[0]))

    def changes_ns(self) -> int:
        """Return when the rate's verdict can change by an estimate, or by none, of the track."""
        return FOREVER_NS if self._rate_columns is None else self._rate_columns.changes_ns(self.taken)

    def take(self, t_ns: int, message: Any) -> None:
        """Take an estimate; a header stamp of 0 says nothing about its age."""
        stamp = message.header.stamp
        stamp_ns = int(stamp.sec) * _S + int(stamp.nanosec)
        self._monitor.add_estimate(t_ns, self._read(message), stamp_ns or None)

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take an estimate as numbers."""
        self._monitor.add_estimate(t_ns, *self._estimate(values))

    def _pose(self, place: int) -> Tuple[Vector, Quaternion]:
        x, y, z, qx, qy, qz, qw = (float(column[place]) for column in self.track.columns[2:9])
        return (x, y, z), (qx, qy, qz, qw)

    @staticmethod
    def _estimate(values: Tuple[Any, ...]) -> Tuple[Estimate, Optional[int]]:
        """Return an estimate and its stamp."""
        seconds, fraction, *rest = values
        x, y, z, qx, qy, qz, qw, *more = map(float, rest)
        estimate = Estimate((x, y, z), (qx, qy, qz, qw))
        if any(more[:6]):  # all zero: the message has none
            estimate = estimate._replace(
                position_variance=(more[0], more[1], more[2]), orientation_variance=(more[3], more[4], more[5])
            )
        if len(more) > 6:  # noqa: PLR2004  (a velocity)
            estimate = estimate._replace(velocity=(more[6], more[7], more[8]))
        return estimate, (seconds * _S + fraction) or None

    def play(self, t_ns: int) -> None:
        """Take what a good estimator says of a vehicle that stands level and still."""
        x, y, z = self._first
        good = Estimate((x, y, z - self._below(t_ns)), self._heading, _SURE, _SURE, (0.0, 0.0, 0.0))
        self._monitor.add_estimate(t_ns, good)

    def join(self, message: Any, rise: Rise) -> None:
        """Play the estimate where the recorded one is first, with its heading; else it would seem to drift there."""
        first = self._read(message)
        x, y, z = first.position
        self._heading = _level(first.orientation, self._heading)
        if all(map(isfinite, (x, y, z))):
            self._first, self._below = (x, y, z), rise.height_m


def _level(orientation: Quaternion, unknown: Quaternion) -> Quaternion:
    """Return the orientation of a level vehicle with the heading of another one; `unknown` where that has none."""
    _, _, z, w = orientation
    length = sqrt(z * z + w * w)
    return (0.0, 0.0, z / length, w / length) if 0 < length < inf else unknown


# --- watchdog feeds ---------------------------------------------------------------------------------------------------
# From messages to the watchdog: that they came, and what the recorded autopilot says of its sensors.


class ComponentFeed(Feed):
    """A message of a component: it came, that is all."""

    def __init__(self, watchdog: Watchdog, name: str, topic: str, period_ns: int) -> None:
        super().__init__(topic, period_ns, decodes=False)
        self._watchdog, self._name = watchdog, name
        self.count = watchdog.counter(name, topic)
        self._rate_columns: Optional[RateColumns] = None

    def ride(self, track: Track, rank: int) -> None:
        """Count all messages of a track."""
        super().ride(track, rank)
        self._rate_columns = RateColumns(self._watchdog.rate(self._name, self.topic), track, self.count)

    def take_many(self, begin: int, end: int) -> None:
        """Count some."""
        if self._rate_columns is not None:
            self._rate_columns.take(begin, end)

    @property
    def steady(self) -> bool:
        """True while the topic comes as intended."""
        return self._rate_columns is not None and self._rate_columns.steady

    def changes_ns(self) -> int:
        """Return when the verdict can change by a message, or by none, of the track."""
        return FOREVER_NS if self._rate_columns is None else self._rate_columns.changes_ns(self.taken)

    def take(self, t_ns: int, message: Any) -> None:  # noqa: ARG002
        """Count it."""
        self._watchdog.add_samples(self._name, t_ns, 1, self.topic)

    def play(self, t_ns: int) -> None:
        """Count it."""
        self._watchdog.add_samples(self._name, t_ns, 1, self.topic)


class HealthFeed(Feed):
    """What the recorded autopilot says of its sensors."""

    def __init__(self, watchdog: Watchdog, topic: str) -> None:
        super().__init__(topic, _S // 5)
        self._watchdog = watchdog

    def take(self, t_ns: int, message: Any) -> None:
        """Take a status."""
        said = health_of(message)
        health = {sensor: said.healthy[sensor.value] for sensor in AutopilotSensor}
        sequences = {sensor: said.sequences[sensor.value] for sensor in AutopilotSensor}
        self._watchdog.add_autopilot(t_ns, health, link_age_s=said.link_age_s, sequences=sequences)

    def play(self, t_ns: int) -> None:
        """Take one of a vehicle whose sensors all work."""
        self._watchdog.add_autopilot(t_ns, dict.fromkeys(AutopilotSensor, True))
