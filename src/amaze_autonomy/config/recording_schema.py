"""Schema of recording.yaml: platforms, groups of topics, storage."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Tuple

from .binding import Row, bind, group_of
from .components_schema import COMPONENT_NAME, TOPIC_NAME
from .kinds import Choice, ListOf, Number, Text, Whole
from .schema import Group, Key, Named

__all__ = ["RECORDING", "Platform", "Recording", "Storage", "TopicGroup"]


@dataclass(frozen=True)
class Storage:
    """Limits of the storage and settings of rosbag.

    Args:
        min_free_fraction: free part of the storage below which no recording starts.
        min_free_gb: free space below which no recording starts.
        compression: of the chunks: none or lz4.
        chunk_kb: size of a chunk.
        buffer_mb: what rosbag may hold in memory.
    """

    min_free_fraction: float = 0.05
    min_free_gb: float = 2.0
    compression: str = "none"
    chunk_kb: int = 768
    buffer_mb: int = 256


@dataclass(frozen=True)
class TopicGroup:
    """Topics that are recorded into one bag."""

    name: str
    topics: Tuple[str, ...]


@dataclass(frozen=True)
class Platform:
    """One companion computer.

    Args:
        name: as in RecordingStatus, e.g. "main".
        groups: names of the groups that it records, one bag each.
    """

    name: str
    groups: Tuple[str, ...]


@dataclass(frozen=True)
class Recording:
    """What is recorded, where, and within which limits.

    Args:
        folder: on each platform; a folder per session is made in it. ~ is the user's home.
        collector: name of the platform that merges and keeps the complete recording.
        platforms: at least one.
        groups: at least one.
        growth_limit_ns: files that have not grown for so long are not being written.
        stop_limit_ns: time in which a recording must be closed.
        storage: limits of the storage.
    """

    folder: str
    collector: str
    platforms: Tuple[Platform, ...]
    groups: Tuple[TopicGroup, ...]
    growth_limit_ns: int = 3_000_000_000
    stop_limit_ns: int = 30_000_000_000
    storage: Storage = field(default_factory=Storage)

    def topics(self, platform: str) -> Tuple[str, ...]:
        """Return all topics that a platform records, in the order of its groups."""
        wanted = next(each.groups for each in self.platforms if each.name == platform)
        groups = {group.name: group.topics for group in self.groups}
        return tuple(topic for name in wanted for topic in groups[name])


# fmt: off
_STORAGE_ROWS: Tuple[Row, ...] = (
    ("min_free_fraction", Number(minimum=0.0, below=1.0), "free part of the storage below which no recording starts", "file systems slow down when they are full"),
    ("min_free_gb", Number(minimum=0.0, maximum=100000.0), "free space below which no recording starts", "two cameras write 1.5 GB in a minute"),
    ("compression", Choice(("none", "lz4")), "of the chunks", "never bz2: with images the recorder loses a third of the data"),
    ("chunk_kb", Whole(1, 65536), "size of a chunk", "what a power cut loses; 64 with lz4"),
    ("buffer_mb", Whole(0, 65536), "what rosbag may hold in memory; 0: no limit", "a slow disk shows here"),
)
# fmt: on
_NAME = Text("the name of a platform", COMPONENT_NAME)
_TOPIC = Text('the name of a topic, e.g. "/lrf/range"; "~" stands for the autonomy node', TOPIC_NAME)
_GROUP = Group(
    "a group of topics",
    (Key("topics", ListOf(_TOPIC, "topics", 1, unique=True), "recorded into one bag"),),
)
_PLATFORM = Group(
    "a companion computer",
    (Key("groups", ListOf(Text("the name of a group", COMPONENT_NAME), "groups", 1, unique=True), "what it records"),),
)
_FOLDER = Text('a folder, e.g. "~/recordings"', r"[^\x00-\x1f\x7f]+")

RECORDING = Group(
    "the recording",
    (
        Key("folder", _FOLDER, "on each platform; a folder per session is made in it", "~ is the user's home"),
        Key(
            "collector", _NAME, "platform that merges and keeps the complete recording", "the one with the larger disk"
        ),
        bind(
            Recording,
            "growth_limit_ns",
            Number(above=0.0, maximum=60.0),
            "files that have not grown for so long are not being written",
            "rosbag writes a chunk a second at telemetry rates",
        ),
        bind(
            Recording,
            "stop_limit_ns",
            Number(above=0.0, maximum=600.0),
            "time in which a recording must be closed",
            "writing the index of a long one takes seconds",
        ),
        Key(
            "storage",
            group_of(Storage, "storage", _STORAGE_ROWS),
            "limits of the storage, settings of rosbag",
            "",
            {},
        ),
        Key("platforms", Named("platforms", COMPONENT_NAME, _PLATFORM, 1), "the companion computers"),
        Key("groups", Named("groups", COMPONENT_NAME, _GROUP, 1), "what is recorded together"),
    ),
)
