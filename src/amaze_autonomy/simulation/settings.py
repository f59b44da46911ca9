"""What the world is made of, read from a configuration: components as streams, missions as waypoints, limits."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Dict, Mapping, Optional, Tuple, Union

from amaze_autonomy.config.model import Configuration
from amaze_autonomy.config.schemas.autonomy import Streams
from amaze_autonomy.missions import Trajectory
from amaze_autonomy.monitoring.initialisation import InitialisationSpec
from amaze_autonomy.monitoring.land_switch import LandSwitchSpec
from amaze_autonomy.monitoring.preflight_specs import (
    BatterySpec,
    EstimateSource,
    LandingSpec,
    RangeSource,
    StateEstimationSpec,
)
from amaze_autonomy.monitoring.specs import ComponentSpec, TopicSpec

from ..engine.events import Mission
from .streams import SampleKind, StreamSettings
from .vehicle.vehicle import PowerSettings, VehicleSettings

_S = 1_000_000_000
_IMU_HZ, _RANGE_HZ = 100.0, 20.0
_ABOVE_TAKEOFF_M = 0.2  # the climb ends a little above the height that the engine waits for

_RANGES = {
    RangeSource.RANGE: SampleKind.RANGE,
    RangeSource.SCAN: SampleKind.SCAN,
    RangeSource.FLOAT: SampleKind.FLOAT,
    RangeSource.POSE: SampleKind.POSE,
}
_ESTIMATES = {
    EstimateSource.ODOMETRY: SampleKind.ODOMETRY,
    EstimateSource.POSE: SampleKind.POSE,
    EstimateSource.POSE_WITH_COVARIANCE: SampleKind.POSE_WITH_COVARIANCE,
}
_NAMES = (
    ("imu", SampleKind.IMU),
    ("camera", SampleKind.IMAGE),
    ("image", SampleKind.IMAGE),
    ("lrf", SampleKind.RANGE),
    ("range", SampleKind.RANGE),
    ("gps", SampleKind.FIX),
    ("mag", SampleKind.FIELD),
    ("baro", SampleKind.PRESSURE),
)


@dataclass(frozen=True)
class Settings:
    """All that the world needs to know.

    Args:
        components: what is watched.
        missions: as the engine knows them.
        trajectories: of each mission by id, one for each of its files.
        landing: how the distance to the ground is measured.
        state_estimation: when states are valid.
        initialisation: of an estimator that must be told to begin.
        battery: when the battery is enough.
        land_switch: the channel of the transmitter that means land.
        platforms: names of the computers that record.
        rates: how often each peer sends its status.
        vehicle: how it flies.
        power: how the battery behaves.
        turn_ns: distance of the world's steps, and of the turns of its watchdog.
    """

    components: Tuple[ComponentSpec, ...] = ()
    missions: Tuple[Mission, ...] = ()
    trajectories: Mapping[str, Tuple[Trajectory, ...]] = field(default_factory=dict)
    landing: LandingSpec = field(default_factory=LandingSpec)
    state_estimation: StateEstimationSpec = field(default_factory=StateEstimationSpec)
    initialisation: InitialisationSpec = field(default_factory=InitialisationSpec)
    battery: BatterySpec = field(default_factory=BatterySpec)
    land_switch: LandSwitchSpec = field(default_factory=LandSwitchSpec)
    platforms: Tuple[str, ...] = ("main", "second")
    rates: Streams = field(default_factory=Streams)
    vehicle: VehicleSettings = field(default_factory=VehicleSettings)
    power: PowerSettings = field(default_factory=PowerSettings)
    turn_ns: int = _S // 10

    def mission(self, mission_id: str) -> Optional[Mission]:
        """Return a mission; None when there is no such mission."""
        return next((mission for mission in self.missions if mission.id == mission_id), None)

    def streams(self) -> Tuple[StreamSettings, ...]:
        """Return every stream: all topics of all components, and what the checks need beyond them."""
        streams: Dict[str, StreamSettings] = {}
        for component in self.components:
            for topic in component.topics:
                streams[topic.topic] = self._stream(component.name, topic)
        for name, kind, rate in self._needed():
            streams.setdefault(name, StreamSettings("", name, kind, rate))
        return tuple(streams.values())

    def _needed(self) -> Tuple[Tuple[str, str, float], ...]:
        states = self.state_estimation
        needed = (
            (self.landing.topic, _RANGES[self.landing.source], _RANGE_HZ),
            (states.imu_topic, SampleKind.IMU, _IMU_HZ),
            (states.topic, _ESTIMATES[states.source], states.rate_hz),
        )
        return tuple(each for each in needed if each[0])

    def _stream(self, component: str, topic: TopicSpec) -> StreamSettings:
        for needed, kind, _ in self._needed():
            if needed == topic.topic:
                return StreamSettings(component, topic.topic, kind, topic.rate_hz)
        return StreamSettings(component, topic.topic, _kind_of(component, topic.topic), topic.rate_hz)


def _kind_of(component: str, topic: str) -> str:
    """Guess what a topic carries from the names of its component and of itself."""
    for text in (topic.lower(), component.lower()):
        for part, kind in _NAMES:
            if part in text:
                return kind
    return SampleKind.FLOAT


def settings_of(configuration: Union[Configuration, Settings]) -> Settings:
    """Read the world's settings from a configuration; settings are returned as they are."""
    if isinstance(configuration, Settings):
        return configuration
    return Settings(
        components=configuration.components,
        missions=configuration.missions,
        trajectories={plan.mission.id: plan.trajectories for plan in configuration.plans},
        landing=configuration.landing,
        state_estimation=configuration.state_estimation,
        initialisation=configuration.initialisation,
        battery=configuration.battery,
        land_switch=configuration.autopilot.land_switch,
        platforms=tuple(platform.name for platform in configuration.recording.platforms),
        vehicle=VehicleSettings(configuration.rules.limits.takeoff_height_m + _ABOVE_TAKEOFF_M, configuration.flight),
        power=PowerSettings(
            flight_endurance_s=configuration.flight.endurance_s,
            cells=configuration.battery.cells or PowerSettings.cells,
        ),
        rates=configuration.streams,
    )
