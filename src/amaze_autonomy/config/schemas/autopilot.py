"""Schema of autopilot.yaml: links, limits of what the vehicle says, commands, what must be so before a takeoff."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Mapping, NamedTuple, Tuple

from amaze_autonomy.monitoring.land_switch import LandSwitchSpec

from ..errors import Place
from ..kinds import Choice, Flag, Number, Places, Text, Url, Whole, parse_endpoint
from ..schema import Group, Key, Named, Row, bind, group_of, make, place_of, refuse_at

_S = 1_000_000_000


@dataclass(frozen=True)
class LinkSettings:
    """Where a node finds the vehicle, and who it is on the link.

    Args:
        url: connection URL.
        system_id: own system id.
        component_id: own component id.
        vehicle_id: system id of the vehicle, the same in both links.
        key_file: with the signing key; empty: unsigned.
        ground_station: whether it announces itself as a ground station.
    """

    url: str = "udpin:127.0.0.1:14540"
    system_id: int = 1
    component_id: int = 191
    vehicle_id: int = 1
    key_file: str = ""
    ground_station: bool = False


@dataclass(frozen=True)
class PlannerLinkSettings(LinkSettings):
    """The link of the mission planner: another endpoint, another component."""

    url: str = "udpin:127.0.0.1:14541"
    component_id: int = 192


@dataclass(frozen=True)
class StateLimits:
    """How old what the vehicle said may be to count.

    Args:
        link_age_limit_ns: anything that the vehicle says.
        mode_age_limit_ns: whether it is armed, and its flight mode.
        state_age_limit_ns: landed state, position, estimator flags.
        speed_age_limit_ns: speeds upwards and over ground.
        system_age_limit_ns: SYS_STATUS.
    """

    link_age_limit_ns: int = 2_500_000_000
    mode_age_limit_ns: int = 5 * _S
    state_age_limit_ns: int = 2 * _S
    speed_age_limit_ns: int = 700_000_000
    system_age_limit_ns: int = 3 * _S


@dataclass(frozen=True)
class GpsSettings:
    """When the GPS has failed.

    Args:
        min_fix_type: GPS_FIX_TYPE that is needed.
        age_limit_ns: longest silence.
        frozen_limit_ns: longest time with the same values.
    """

    min_fix_type: int = 3
    age_limit_ns: int = 2 * _S
    frozen_limit_ns: int = 3 * _S


@dataclass(frozen=True)
class BatteryCaps:
    """The most that is believed to be left in each charge state of the autopilot.

    Args:
        low_fraction: LOW.
        critical_fraction: CRITICAL and UNHEALTHY.
        emergency_fraction: EMERGENCY.
    """

    low_fraction: float = 0.15
    critical_fraction: float = 0.07
    emergency_fraction: float = 0.05


@dataclass(frozen=True)
class CommandSettings:
    """Land and disarm.

    Args:
        repeat_ns: time between two sendings.
        limit_ns: time in which the vehicle must show the effect.
        reply_ns: time after which a service answers that it was sent, though nothing is confirmed.
        exit_limit_ns: time that the node stays for a landing mode to be confirmed when it is told to end in flight.
    """

    repeat_ns: int = 300_000_000
    limit_ns: int = 5 * _S
    reply_ns: int = 800_000_000
    exit_limit_ns: int = 3 * _S


@dataclass(frozen=True)
class TakeoffNeeds:
    """What must be so before a takeoff.

    Args:
        rc: a transmitter is heard; otherwise that it is not is a warning.
        home: the home position is set.
        clock_difference_limit_ns: of the vehicle's and this computer's time of day.
    """

    rc: bool = True
    home: bool = True
    clock_difference_limit_ns: int = _S


@dataclass(frozen=True)
class AutopilotSettings:
    """Everything that autopilot.yaml says.

    Args:
        backend: mavlink or mavros.
        mavros: namespace of mavros.
        link: of the autopilot node.
        planner_link: of the mission planner.
        limits: how old what the vehicle said may be.
        gps: when it has failed.
        battery: the most that is believed in each charge state.
        commands: land and disarm.
        needs: before a takeoff.
        land_switch: a channel of the transmitter that means: land.
        rates_hz: of messages that are asked for at another rate than that of the autopilot's node; 0: not at all.
        parameters: of a PX4, by name, and their values; with those for set-points where they are used.
        ardupilot_parameters: of an ArduPilot.
        offboard_parameters: that matter besides when a mission is flown by set-points.
        rates_places: where each of `rates_hz` stands; which messages there are is known further on.
    """

    backend: str = "mavlink"
    mavros: str = "/mavros"
    link: LinkSettings = field(default_factory=LinkSettings)
    planner_link: LinkSettings = field(default_factory=PlannerLinkSettings)
    limits: StateLimits = field(default_factory=StateLimits)
    gps: GpsSettings = field(default_factory=GpsSettings)
    battery: BatteryCaps = field(default_factory=BatteryCaps)
    commands: CommandSettings = field(default_factory=CommandSettings)
    needs: TakeoffNeeds = field(default_factory=TakeoffNeeds)
    land_switch: LandSwitchSpec = field(default_factory=LandSwitchSpec)
    rates_hz: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    ardupilot_parameters: Mapping[str, float] = field(default_factory=dict)
    offboard_parameters: Mapping[str, float] = field(default_factory=dict)
    rates_places: Mapping[str, Place] = field(default_factory=dict, compare=False, repr=False)

    def with_offboard(self) -> AutopilotSettings:
        """Return the settings for missions that are flown by set-points."""
        return replace(self, parameters={**self.parameters, **self.offboard_parameters})


_FRACTION = Number(minimum=0.0, maximum=1.0)


def _time(most: float = 60.0) -> Number:
    return Number(above=0.0, maximum=most)


# fmt: off
_LINK_ROWS: Tuple[Row, ...] = (
    ("url", Url(), "where the vehicle is", "as MAVLink people write it; docs/autopilot.md"),
    ("system_id", Whole(1, 255), "own system id", "by convention that of the vehicle"),
    ("component_id", Whole(1, 255), "own component id", "another for each node that speaks on a link"),
    ("vehicle_id", Whole(1, 255), "system id of the vehicle, the same in both links", "several vehicles may share a radio: the one that is checked is the one that flies"),
    ("key_file", Text("a file", r"[^\x00-\x1f\x7f]*"), "with the key for signing; empty: nothing is signed or verified", "chmod 600; the time stamp of signatures is kept beside it"),
    ("ground_station", Flag(), "announce itself as a ground station", "PX4 withholds its texts on a link where it hears none, but then also misses no lost ground station"),
)
_LIMIT_ROWS: Tuple[Row, ...] = (
    ("link_age_limit_ns", _time(), "nothing heard for longer than this: no link, for the checks", "at 1 Hz two heartbeats"),
    ("mode_age_limit_ns", _time(), "armed and flight mode older than this are unknown", "lost heartbeats are asked for again"),
    ("state_age_limit_ns", _time(), "landed state, position and flags of the estimator older than this are unknown", "position messages stay fresh while the estimate is lost"),
    ("speed_age_limit_ns", _time(), "speeds older than this are unknown", "a vehicle that stood half a second ago may have flown on; PX4 and ArduPilot are asked for 10 a second"),
    ("system_age_limit_ns", _time(), "health of the sensors older than this is unknown", "sent twice a second"),
)
_GPS_ROWS: Tuple[Row, ...] = (
    ("min_fix_type", Whole(0, 8), "least GPS_FIX_TYPE: 3 is three-dimensional, 6 RTK", "SYS_STATUS tells a loss 8 s late, or never"),
    ("age_limit_ns", _time(), "longest silence of GPS_RAW_INT", ""),
    ("frozen_limit_ns", _time(), "longest time with the same values or time stamp", "a hung receiver repeats itself"),
)
_BATTERY_ROWS: Tuple[Row, ...] = (
    ("low_fraction", _FRACTION, "the most that is believed to be left when the autopilot says LOW", "ArduPilot's fraction ignores the voltage, its charge state does not"),
    ("critical_fraction", _FRACTION, "CRITICAL or UNHEALTHY", ""),
    ("emergency_fraction", _FRACTION, "EMERGENCY", ""),
)
_COMMAND_ROWS: Tuple[Row, ...] = (
    ("repeat_ns", _time(10), "pause between two sendings of a command", "a lost packet costs this"),
    ("limit_ns", _time(), "time in which the vehicle must show the effect", "confirmed by its heartbeat, never by an acknowledgement"),
    ("reply_ns", _time(10), "time after which a service answers that it was sent, though nothing is confirmed yet", "below command_reply_limit_s of the engine"),
    ("exit_limit_ns", _time(12), "how long the node stays for the landing mode when it is told to end in flight", "roslaunch waits 15 s before it kills"),
)
_NEED_ROWS: Tuple[Row, ...] = (
    ("rc", Flag(), "a transmitter must be heard; off: it is a warning", "the pilot is the last route"),
    ("home", Flag(), "the home position must be set; off: it is a warning", "returning and global waypoints need it, indoor flights do not"),
    ("clock_difference_limit_ns", _time(3600), "time of day of the vehicle and of this computer that differs more is a warning", "recordings of both are compared"),
)
_SWITCH_ROWS: Tuple[Row, ...] = (
    ("channel", Whole(0, 18), "of the transmitter, from 1, that means land; 0: none does", "one that the autopilot has no other use for"),
    ("above_us", Number(minimum=900.0, maximum=1950.0), "width of its pulse in microseconds above which it is on", "a switch of three positions is at 1000, 1500 and 2000"),
    ("hold_ns", Number(minimum=0.6, maximum=5.0), "how long it must be on; it counts with the next SYS_STATUS after that", "PX4 notices a lost transmitter after 0.5 s, COM_RC_LOSS_T; until then its receiver may make channels up"),
    ("age_limit_ns", _time(10), "channels that are older say nothing", "without a transmitter the autopilot decides"),
)
# fmt: on
_PARAMETER = Number(minimum=-1e9, maximum=1e9)

AUTOPILOT = Group(
    "the autopilot",
    (
        bind(
            AutopilotSettings,
            "backend",
            Choice(("mavlink", "mavros")),
            "how the vehicle is reached",
            "mavros for stacks that have it running and cannot share its port",
        ),
        bind(AutopilotSettings, "mavros", Text("a namespace", r"/[A-Za-z0-9_/]+"), "of mavros, for the backend mavros"),
        Key("link", group_of(LinkSettings, "a link", _LINK_ROWS), "of the autopilot node", "", {}),
        Key(
            "planner_link",
            group_of(PlannerLinkSettings, "a link", _LINK_ROWS),
            "of the mission planner: an endpoint of its own",
            "with the planner hung, the autopilot node still lands",
            {},
        ),
        Key("limits", group_of(StateLimits, "ages", _LIMIT_ROWS), "how old what the vehicle said may be", "", {}),
        Key("gps", group_of(GpsSettings, "limits of the GPS", _GPS_ROWS), "when the GPS has failed", "", {}),
        Key("battery", group_of(BatteryCaps, "caps", _BATTERY_ROWS), "what the charge state makes of a level", "", {}),
        Key("commands", group_of(CommandSettings, "limits", _COMMAND_ROWS), "land and disarm", "", {}),
        Key("needs", group_of(TakeoffNeeds, "needs", _NEED_ROWS), "what must be so before a takeoff", "", {}),
        Key(
            "land_switch",
            group_of(LandSwitchSpec, "a switch", _SWITCH_ROWS),
            "a switch of the transmitter that asks the engine to land",
            "the pilot stays a pilot: nothing is taken over",
            {},
        ),
        Key(
            "rates_hz",
            Named("messages of MAVLink", r"[A-Z][A-Z0-9_]{1,49}", Number(minimum=0.0, maximum=50.0)),
            "messages that are asked for at another rate than ours (docs/autopilot.md); 0: not asked for, but by the planner, which needs its own but HEARTBEAT and CURRENT_MODE",
            "a rule on a new message asks for it in every configuration; a slow radio may want less",
            {},
        ),
        Key(
            "parameters",
            Named("parameters of the autopilot", r"[A-Z][A-Z0-9_]{0,15}", _PARAMETER),
            "parameters that are read and compared before a takeoff; one that differs is a warning, and that none is named",
            "failsafes that somebody changed",
            {},
        ),
        Key(
            "ardupilot_parameters",
            Named("parameters of the autopilot", r"[A-Z][A-Z0-9_]{0,15}", _PARAMETER),
            "the same of an ArduPilot, whose names are others",
            "compared instead of `parameters` when its heartbeat says that it is one",
            {},
        ),
        Key(
            "offboard_parameters",
            Named("parameters of the autopilot", r"[A-Z][A-Z0-9_]{0,15}", _PARAMETER),
            "the same, when one of the missions is flown by set-points (controller: offboard)",
            "what the autopilot does when the stream stops is not left to chance: check-config warns where COM_OBL_RC_ACT is not compared",
            {},
        ),
    ),
)


_AUTOPILOT_COMPONENT = 1  # MAV_COMP_ID_AUTOPILOT1


def _check_links(values: Mapping[str, Any], places: Places) -> None:
    """Refuse two links that cannot both be: on one endpoint, with one address, to two vehicles, or one signed alone.

    Raises:
        ConfigError: they are.
    """
    link, planner = values["link"], values["planner_link"]
    if parse_endpoint(planner["url"]).excludes(parse_endpoint(link["url"])):
        as_link = "as link.url" if planner["url"] == link["url"] else f"as link.url is ({link['url']!r})"
        right = "must be an endpoint of its own; a router shares a serial port (docs/autopilot.md)"
        refuse_at(("planner_link", "url"), places, f"is {planner['url']!r}, {as_link}", right)
    names = ("system_id", "component_id")
    if all(planner[name] == link[name] for name in names):
        right = "must be another one: each node that speaks has its own"
        refuse_at(("planner_link", "component_id"), places, f"is {link['component_id']}, as link.component_id", right)
    if planner["vehicle_id"] != link["vehicle_id"]:
        wrong = f"is {planner['vehicle_id']}, and link.vehicle_id is {link['vehicle_id']}"
        right = "must be the same: the mission planner would arm and fly another vehicle than the one that is checked"
        refuse_at(("planner_link", "vehicle_id"), places, wrong, f"{right} and landed")
    for name, own in (("link", link), ("planner_link", planner)):
        if (own["system_id"], own["component_id"]) == (own["vehicle_id"], _AUTOPILOT_COMPONENT):
            address = f"system {own['system_id']}, component {own['component_id']}"
            right = f"must be another one: {address} is the address of the vehicle's autopilot"
            refuse_at((name, "component_id"), places, f"is {own['component_id']}", right)
    if bool(planner["key_file"]) != bool(link["key_file"]):
        right = "must be named in both or in none: a vehicle that signs hears nobody who does not"
        named, other = ("link", "planner_link") if link["key_file"] else ("planner_link", "link")
        wrong = f"is {values[named]['key_file']!r}, and {other}.key_file is empty"
        refuse_at((named, "key_file"), places, wrong, right)


def _check_commands(values: Mapping[str, Any], places: Places) -> None:
    """Refuse a command that is given up before it is sent again.

    Raises:
        ConfigError: about the pause, or about the limit where it alone is given.
    """
    pause_s, limit_s, why = values["commands"]["repeat_s"], values["commands"]["limit_s"], "else nothing is sent again"
    if pause_s < limit_s:
        return
    pause, limit = ("commands", "repeat_s"), ("commands", "limit_s")
    if pause not in places and limit in places:
        refuse_at(limit, places, f"is {limit_s:g}", f"must be above commands.repeat_s ({pause_s:g}): {why}")
    refuse_at(pause, places, f"is {pause_s:g}", f"must be below commands.limit_s ({limit_s:g}): {why}")


class JudgedRate(NamedTuple):
    """A message that age limits judge: the rate at which it is asked for unless `rates_hz` says another, the limits."""

    rate_hz: float
    limits: Tuple[str, ...]


_LIMITS_OF_A_STATE = ("limits.state_age_limit_s",)
JUDGED_RATES: Mapping[str, JudgedRate] = {
    "HEARTBEAT": JudgedRate(5.0, ("limits.mode_age_limit_s",)),
    "EXTENDED_SYS_STATE": JudgedRate(5.0, _LIMITS_OF_A_STATE),
    "SYS_STATUS": JudgedRate(2.0, ("limits.system_age_limit_s",)),
    "GPS_RAW_INT": JudgedRate(5.0, ("gps.age_limit_s", "gps.frozen_limit_s")),
    "LOCAL_POSITION_NED": JudgedRate(10.0, ("limits.speed_age_limit_s", *_LIMITS_OF_A_STATE)),
    "ESTIMATOR_STATUS": JudgedRate(5.0, _LIMITS_OF_A_STATE),
    "EKF_STATUS_REPORT": JudgedRate(5.0, _LIMITS_OF_A_STATE),
    "ATTITUDE": JudgedRate(10.0, _LIMITS_OF_A_STATE),
    "RC_CHANNELS": JudgedRate(10.0, ("land_switch.age_limit_s",)),
}
_PERIODS = 2  # within a limit, or what comes in time is late already


def _check_rates(values: Mapping[str, Any], places: Places) -> None:
    """Refuse a message that is asked for so seldom that it is too old between two: nothing would say what is wrong.

    What is not asked for (0) comes unasked, or others ask for it; the land switch is never left to that.

    Raises:
        ConfigError: about the rate, or about the limit where the rate is ours.
    """
    given, has_switch = values["rates_hz"], values["land_switch"]["channel"] > 0
    if has_switch and given.get("RC_CHANNELS") == 0:
        right = "must be above 0, or left out: land_switch has a channel, and would never say land"
        refuse_at(("rates_hz", "RC_CHANNELS"), places, "is 0", right)
    for message, (ours_hz, limits) in JUDGED_RATES.items():
        rate_hz = given.get(message, ours_hz)
        if not rate_hz or (message == "RC_CHANNELS" and not has_switch):
            continue
        for limit in limits:
            group, key = limit.split(".")
            limit_s = values[group][key]
            if _PERIODS / rate_hz <= limit_s + 1e-9:
                continue
            if message in given:
                right = f"must be at least {_PERIODS / limit_s:.3g}, two periods within {limit} ({limit_s:g})"
                refuse_at(("rates_hz", message), places, f"is {rate_hz:g}", f"{right}: else it is old between two")
            right = f"must be at least {_PERIODS / rate_hz:.3g}, two periods of {message}, asked for at {rate_hz:g} Hz"
            refuse_at((group, key), places, f"is {limit_s:g}", f"{right}: else it is old between two")


def autopilot_of(values: Mapping[str, Any], places: Places) -> AutopilotSettings:
    """Return the settings of the values of autopilot.yaml."""
    if values["backend"] == "mavlink":  # behind mavros there are no links of ours
        _check_links(values, places)
    _check_commands(values, places)
    _check_rates(values, places)

    def group(name: str, cls: Any) -> Any:
        return make(cls, values[name], (name,), places)

    return make(
        AutopilotSettings,
        values,
        (),
        places,
        link=group("link", LinkSettings),
        planner_link=group("planner_link", PlannerLinkSettings),
        limits=group("limits", StateLimits),
        gps=group("gps", GpsSettings),
        battery=group("battery", BatteryCaps),
        commands=group("commands", CommandSettings),
        needs=group("needs", TakeoffNeeds),
        land_switch=group("land_switch", LandSwitchSpec),
        rates_hz=dict(values["rates_hz"]),
        parameters=dict(values["parameters"]),
        ardupilot_parameters=dict(values["ardupilot_parameters"]),
        offboard_parameters=dict(values["offboard_parameters"]),
        rates_places={name: place_of(("rates_hz", name), places) for name in values["rates_hz"]},
    )
