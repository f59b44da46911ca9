"""Topic maps: which topic of a recording is which component, and where each reading comes from. Strict YAML.

A map says nothing about what is decided: that is the configuration. It says what the recording is. `SCHEMA` is the
whole of it; docs/replay.md explains it with examples. A unit is part of each key.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Collection, Dict, Mapping, Optional, Tuple

from amaze_autonomy import interface
from amaze_autonomy.config import ConfigError, Place
from amaze_autonomy.config.document import Entry, Scalar, read
from amaze_autonomy.config.kinds import Address, Choice, Flag, ListOf, Number, Places, Text, Whole
from amaze_autonomy.config.schema import REQUIRED, Group, Key, Named, bind, field_value, key_name, make
from amaze_autonomy.monitoring.specs import (
    GROUPS,
    AutopilotSensor,
    EstimateSource,
    LandingSpec,
    StateEstimationSpec,
    TopicSpec,
)

from ...config.schemas.sensors import COMPONENT_NAME, LANDING_DETECTION, SEVERITY, STATE_ESTIMATION, TOPIC_NAME
from ..recordings.fields import FIELD_PATH

MAPS = Path(__file__).parent
STATUSES = (*(row.name for row in interface.STATUSES), "journal")


@dataclass(frozen=True)
class ComponentMap:
    """One component that the recording has; None: as the configuration says of the component of this name.

    `topic_otherwise` is its topic in a recording without that of `topic`.
    """

    name: str
    topic: TopicSpec
    required: bool = True
    group: Optional[str] = None
    severity: Optional[str] = None
    wait_limit_ns: Optional[int] = None
    autopilot: Optional[str] = None
    topic_otherwise: Optional[str] = None

    def of(self, recorded: Collection[str]) -> ComponentMap:
        """Return the component for a recording of these topics."""
        if self.topic_otherwise is None or self.topic.topic in recorded or self.topic_otherwise not in recorded:
            return self
        return replace(self, topic=replace(self.topic, topic=self.topic_otherwise))


@dataclass(frozen=True)
class Reading:
    """Where one kind of reading comes from.

    Args:
        topic: that carries it.
        fields: path of each part of it.
        scale: factor that makes SI of the message's unit.
        offset: added after that.
        on_ground: values of the field that mean "on the ground"; for `landed`.
        source: kind of message; for `estimate`.
        unknown: values of the field that say nothing; for `landed`.
        mission: flight modes in which the recorded vehicle flew its mission; for `mode`.
        on: values of the field that mean that a failsafe acts; for `failsafe`.
    """

    topic: str
    fields: Mapping[str, str]
    scale: float = 1.0
    offset: float = 0.0
    on_ground: Tuple[str, ...] = ()
    source: str = ""
    unknown: Tuple[str, ...] = ()
    mission: Tuple[str, ...] = ()
    on: Tuple[str, ...] = ()


@dataclass(frozen=True)
class Script:
    """What the scripted world does.

    Args:
        select_at_ns: when the user selects the mission, from the first message; negative: before the recording starts;
            None: at the first message, unless `before_arming_ns` says when.
        sensors_until_ns: until then the script plays a topic as nominal that has not begun yet, from the first message.
        retries: how often the user retries after a failed check before giving up.
        retry_after_ns: how long the user takes for it.
        begins: auto, ground or air: where the vehicle is at the first message.
        before_arming_ns: it is selected so long before the first recorded arming, where there is one, but not before
            `select_at_ns`; None: at that.
    """

    select_at_ns: Optional[int] = None
    sensors_until_ns: int = 0
    retries: int = 0
    retry_after_ns: int = 5_000_000_000
    begins: str = "auto"
    before_arming_ns: Optional[int] = None


@dataclass(frozen=True)
class TopicMap:
    """A map: `readings` by name (imu, range, armed, ...: rows of `_READINGS`), `statuses` by name.

    `landing` and `state_estimation` are what the recording's vehicle has differently: fields of the specifications.
    `as_configured`: every component of the configuration whose topics are all in the recording is watched.
    `statuses_decide`: what a recorded watchdog and landing detection said decides, not the recorded sensors.
    """

    name: str
    about: str
    components: Tuple[ComponentMap, ...]
    readings: Mapping[str, Reading]
    statuses: Mapping[str, str]
    landing: Mapping[str, Any]
    state_estimation: Mapping[str, Any]
    script: Script
    as_configured: bool = False
    statuses_decide: bool = False

    @property
    def topics(self) -> Tuple[str, ...]:
        """Every topic of the map, each once, in the order of the map: its place is its rank among equal times."""
        names = [component.topic.topic for component in self.components]
        names += [reading.topic for reading in self.readings.values()] + list(self.statuses.values())
        return tuple(dict.fromkeys(names))

    def of(self, recorded: Collection[str]) -> TopicMap:
        """Return the map for a recording of these topics: what has an `otherwise` is that where it must be."""
        readings = dict(self.readings)
        for name in _TWICE:
            other, first = readings.pop(name + _OTHERWISE, None), readings.get(name)
            if other is not None and other.topic in recorded and (first is None or first.topic not in recorded):
                readings[name] = other
        return replace(self, readings=readings, components=tuple(each.of(recorded) for each in self.components))


def _optional(group: Group, *left_out: str) -> Group:
    """Return a group of sensors.yaml of which nothing has to be given."""
    return Group(group.said, tuple(replace(key, default=None) for key in group.keys if key.name not in left_out))


@dataclass(frozen=True)
class _Value(Text):
    """A value of a field: a text, a number, true or false."""

    def read(self, entry: Entry, address: Address, places: Places) -> str:
        """Return the value as text."""
        if not isinstance(entry, Scalar) or entry.tag != "bool":
            return super().read(entry, address, places)
        places[address] = entry.place
        return str(entry.text.lower() in ("true", "yes", "on"))


_TIME = Number(above=0.0, maximum=600.0)
_SMALL = Number(above=0.0, below=1.0)
_TOPIC = Key("topic", Text('the name of a topic, e.g. "/imu/data"', TOPIC_NAME), "topic that carries it")
_PATH = Text("the path of a field, e.g. pose.position.z or values[5]", FIELD_PATH)
_SCALE = Key("scale", Number(minimum=-1e6, maximum=1e6), "factor that makes SI of the message's unit", "", 1.0)
_OTHERWISE, _TWICE = "_otherwise", ("imu", "height")  # keys for a recording without the topic; readings that have one
_OFFSET = Key("offset_m", Number(minimum=-1e5, maximum=1e5), "added after scaling", "", 0.0)


def _field(name: str, default: Any = None) -> Key:
    return Key(name, _PATH, f"field with the {name.replace('_', ' ')}", "", default)


def _reading(name: str, said: str, *keys: Key) -> Key:
    return Key(name, Group(said, (_TOPIC, *keys)), said, "", None)


def _twice(name: str, *keys: Key) -> Key:
    return _reading(name + _OTHERWISE, f"the same, in a recording without the topic of `{name}`", *keys)


_IMU = (_field("acceleration", "linear_acceleration"), _field("turn_rate"), _field("orientation"), _SCALE)
_HEIGHT = (_field("height", REQUIRED), _SCALE, _OFFSET)
_COMPONENT = Group(
    "a component of the recording",
    (
        _TOPIC,
        replace(_TOPIC, name=f"topic{_OTHERWISE}", meaning="the same, in a recording without `topic`", default=None),
        Key("rate_hz", Number(minimum=0.001, maximum=1e5), "messages per second that are intended"),
        bind(TopicSpec, "tolerance_fraction", _SMALL, "deviation of the rate that is still as intended"),
        bind(TopicSpec, "rate_failed_fraction", _SMALL, "part of the rate below which it has failed"),
        bind(TopicSpec, "age_limit_ns", _TIME, "silence after which it has failed"),
        bind(TopicSpec, "window_ns", _TIME, "time over which the rate is measured"),
        Key("required", Flag(), "must work before takeoff", "", True),
        Key("group", Choice(GROUPS), "px4 or other; left out: as configured, else other", "", None),
        Key("severity", SEVERITY, "how bad its failure is; left out: as configured, else moderate", "", None),
        Key("wait_limit_s", _TIME, "how long a flight may wait for it; left out: as configured", "", None),
        Key(
            "autopilot",
            Choice(tuple(sensor.value for sensor in AutopilotSensor)),
            "sensor whose health the recorded autopilot tells",
            "",
            None,
        ),
    ),
)
_SCRIPT = Group(
    "the scripted world",
    (
        Key(
            "select_at_s",
            Number(minimum=-600, maximum=1e6),
            "when the mission is selected, from the first message; left out: at it, or as select_before_arming_s says",
            "",
            None,
        ),
        Key(
            "sensors_until_s", Number(minimum=0, maximum=1e6), "until then silent topics are played as nominal", "", 0.0
        ),
        Key("retries", Whole(0, 1000), "how often a failed check is retried", "", 0),
        Key("retry_after_s", Number(above=0, maximum=3600), "after how long", "", 5.0),
        Key(
            "begins",
            Choice(("auto", "ground", "air")),
            "where the vehicle is at the first message; auto: as its status, landed, range or height say",
            "",
            "auto",
        ),
        Key(
            "select_before_arming_s",
            Number(above=0, maximum=600),
            "how long before the first recorded arming it is selected; with select_at_s: not before that",
            "",
            None,
        ),
    ),
)
_READINGS = Group(
    "where readings come from",
    (
        _reading("imu", "an accelerometer", *_IMU),
        _twice("imu", *_IMU),
        _reading(
            "estimate",
            "an estimate of the state",
            Key("source", Choice(tuple(s.value for s in EstimateSource)), "kind of message", "", "odometry"),
        ),
        _reading("range", "a distance to the ground", _field("distance", "range"), _SCALE),
        _reading("height", "the height above the takeoff position", *_HEIGHT),
        _twice("height", *_HEIGHT),
        _reading("battery", "the battery", _field("fraction", "percentage"), _field("voltage"), _SCALE),
        _reading("armed", "whether the motors are armed", _field("armed", "data")),
        _reading(
            "landed",
            "what the vehicle says of the ground",
            _field("landed", "data"),
            Key(
                "on_ground",
                ListOf(_Value("a value", numbers=True), "values that mean on the ground", 1),
                "values that mean on the ground",
            ),
            Key(
                "unknown",
                ListOf(_Value("a value", numbers=True), "values that say nothing", 0),
                "values that say nothing",
                "",
                [],
            ),
        ),
        _reading(
            "mode",
            "the flight mode",
            _field("mode", "mode"),
            Key(
                "mission",
                ListOf(Text("a flight mode, as recorded"), "modes in which it flew its mission", 0),
                "modes in which the recorded vehicle flew its mission: taken for the mode that is commanded here",
                "",
                [],
            ),
        ),
        _reading(
            "failsafe",
            "whether the autopilot acts by a failsafe of its own",
            _field("failsafe", "failsafe"),
            Key(
                "on",
                ListOf(_Value("a value", numbers=True), "values that mean that it does", 1),
                "values that mean that it does",
                "",
                ["True", "1"],
            ),
        ),
        _reading(
            "texts",
            "what the vehicle says in words; lines of the timeline",
            _field("text", "text"),
            _field("severity"),
        ),
    ),
)
_STATUS_KEYS = tuple(
    Key(name, Text("the name of a topic", TOPIC_NAME), f"topic with the recorded {name}", "", None) for name in STATUSES
)
SCHEMA = Group(
    "a topic map",
    (
        Key("about", Text("one line about the recording", longest=400), "what the recording is"),
        Key("components", Named("components", COMPONENT_NAME, _COMPONENT), "what is watched", "", {}),
        Key(
            "components_as_configured",
            Flag(),
            "watch what the configuration watches, as far as it is recorded",
            "",
            False,
        ),
        Key("readings", _READINGS, "where readings come from", "", {}),
        Key("statuses", Group("recorded statuses of our own nodes", _STATUS_KEYS), "recorded statuses", "", {}),
        Key(
            "recorded_statuses",
            Choice(("compared", "decide")),
            "what watchdog and landing detection said is compared with what the recorded sensors say, or decides "
            "instead of them",
            "",
            "compared",
        ),
        Key(
            "landing",
            _optional(LANDING_DETECTION, "topic", "source", "scale"),
            "landing detection of this vehicle",
            "",
            {},
        ),
        Key(
            "state_estimation",
            _optional(STATE_ESTIMATION, "topic", "source", "imu_topic"),
            "state check of this vehicle",
            "",
            {},
        ),
        Key("script", _SCRIPT, "the scripted world", "", {}),
    ),
)


def map_names() -> Tuple[str, ...]:
    """Return the names of the maps that ship with the package."""
    return tuple(sorted(path.stem for path in MAPS.glob("*.yaml")))


def load_map(name: str) -> TopicMap:
    """Load a map by the name of one that ships with the package, or by its path.

    Raises:
        ConfigError: There is no such map, or it is not one.
    """
    path = MAPS / f"{name}.yaml" if name in map_names() else Path(name)
    if not path.is_file():
        right = f"name a file, or one of {', '.join(map_names())}"
        raise ConfigError(Place(name), "", "is no topic map", right)
    places: Places = {}
    values = SCHEMA.read(read(path), (), places)
    return TopicMap(
        name=path.stem,
        about=values["about"],
        components=tuple(_component(name, each, places) for name, each in values["components"].items()),
        readings={name: _made_reading(each) for name, each in values["readings"].items() if each is not None},
        statuses={name: topic for name, topic in values["statuses"].items() if topic is not None},
        landing=_spec_fields(LandingSpec, values["landing"]),
        state_estimation=_spec_fields(StateEstimationSpec, values["state_estimation"]),
        script=_script(values["script"]),
        as_configured=values["components_as_configured"],
        statuses_decide=values["recorded_statuses"] == "decide",
    )


def _component(name: str, values: Dict[str, Any], places: Places) -> ComponentMap:
    wait_s = values["wait_limit_s"]
    return ComponentMap(
        name=name,
        topic=make(TopicSpec, values, ("components", name), places),
        required=values["required"],
        group=values["group"],
        severity=values["severity"],
        wait_limit_ns=None if wait_s is None else _ns(wait_s),
        autopilot=values["autopilot"],
        topic_otherwise=values["topic_otherwise"],
    )


def _made_reading(values: Dict[str, Any]) -> Reading:
    known = ("topic", "scale", "offset_m", "on_ground", "source", "unknown", "mission", "on")
    paths = {key: path for key, path in values.items() if key not in known and path is not None}
    return Reading(
        topic=values["topic"],
        fields=paths,
        scale=values.get("scale", 1.0),
        offset=values.get("offset_m", 0.0),
        on_ground=tuple(values.get("on_ground", ())),
        source=values.get("source", ""),
        unknown=tuple(values.get("unknown", ())),
        mission=tuple(values.get("mission", ())),
        on=tuple(values.get("on", ())),
    )


def _script(values: Dict[str, Any]) -> Script:
    before_s = values["select_before_arming_s"]
    return Script(
        select_at_ns=None if values["select_at_s"] is None else _ns(values["select_at_s"]),
        sensors_until_ns=_ns(values["sensors_until_s"]),
        retries=values["retries"],
        retry_after_ns=_ns(values["retry_after_s"]),
        begins=values["begins"],
        before_arming_ns=None if before_s is None else _ns(before_s),
    )


def _spec_fields(cls: Any, values: Dict[str, Any]) -> Dict[str, Any]:
    """Return the fields of a specification whose keys are given."""
    names = [entry.name for entry in fields(cls) if values.get(key_name(entry.name)) is not None]
    return {name: field_value(name, values[key_name(name)]) for name in names}


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)
