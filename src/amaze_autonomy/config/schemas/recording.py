"""Schema of recording.yaml: platforms, groups of topics, storage."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Optional, Tuple

from ..kinds import Choice, Flag, ListOf, Number, Pattern, Text, Whole
from ..schema import Group, Key, Named, Row, bind, group_of
from .sensors import COMPONENT_NAME, TOPIC_NAME


@dataclass(frozen=True)
class Storage:
    """Limits of the storage and settings of rosbag.

    Args:
        min_free_fraction: free part of the storage below which no recording starts.
        min_free_gb: free space below which no recording starts.
        compression: of the chunks: none or lz4.
        chunk_kb: size of a chunk; None: what suits the compression.
        buffer_mb: what rosbag may hold in memory.
        split_mb: size at which a bag is closed and the next begun; 0: never.
        reserve_mb: free space at which rosbag stops to write.
    """

    min_free_fraction: float = 0.05
    min_free_gb: float = 2.0
    compression: str = "none"
    chunk_kb: Optional[int] = None
    buffer_mb: int = 256
    split_mb: int = 0
    reserve_mb: int = 200


@dataclass(frozen=True)
class TopicGroup:
    """Topics that are recorded into one bag.

    Args:
        name: of the group.
        topics: names.
        match: regular expressions; every topic that one of them matches is recorded, too.
        exclude: regular expression; topics that it matches are not recorded; empty: none.
        compression: of the chunks; None: as the storage says; so for chunk_kb and buffer_mb.
        expected_mb_s: what it writes in a second, for the free space that a mission needs.
    """

    name: str
    topics: Tuple[str, ...]
    match: Tuple[str, ...] = ()
    exclude: str = ""
    compression: Optional[str] = None
    chunk_kb: Optional[int] = None
    buffer_mb: Optional[int] = None
    expected_mb_s: float = 1.0


@dataclass(frozen=True)
class Transfer:
    """How the collector gets what another platform has recorded.

    Args:
        by: rsync (over ssh), shared (the folder is mounted on the collector), or here (the collector uses it in place).
        host: name or user@name of the other computer, for rsync.
        ssh_port: of its ssh server.
        ssh_key: file with the private key; empty: as ssh is configured.
        mount: where the other computer's recordings are mounted, for shared; empty: under the same path.
        bandwidth_mb_s: the most that rsync may take of the network; 0: all.
        stall_limit_ns: a connection that moves no byte for so long is given up, and tried again.
        limit_ns: time in which everything must be here.
    """

    by: str = "here"
    host: str = ""
    ssh_port: int = 22
    ssh_key: str = ""
    mount: str = ""
    bandwidth_mb_s: float = 0.0
    stall_limit_ns: int = 10_000_000_000
    limit_ns: int = 900_000_000_000


@dataclass(frozen=True)
class Platform:
    """One companion computer.

    Args:
        name: as in RecordingStatus, e.g. "main".
        groups: names of the groups that it records, one bag each.
        transfer: how the collector gets its recordings.
        has_transfer: the file says which way it is.
    """

    name: str
    groups: Tuple[str, ...]
    transfer: Transfer = field(default_factory=Transfer)
    has_transfer: bool = field(default=True, compare=False)


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
        start_limit_ns: time in which every platform must prove that it records.
        platform_limit_ns: a platform whose status is older is silent.
        keep_parts: whether what was merged is kept after the complete recording is verified.
        apply_clock_offset: whether a merge corrects the record times of other platforms by the measured offsets.
        duplicates: what a merge does about messages that two platforms recorded.
        tolerated_topics: of which messages may be lost, and the data of a flight is complete still.
    """

    folder: str
    collector: str
    platforms: Tuple[Platform, ...]
    groups: Tuple[TopicGroup, ...]
    growth_limit_ns: int = 3_000_000_000
    stop_limit_ns: int = 30_000_000_000
    storage: Storage = field(default_factory=Storage)
    start_limit_ns: int = 12_000_000_000
    platform_limit_ns: int = 5_000_000_000
    keep_parts: bool = True
    apply_clock_offset: bool = False
    duplicates: str = "count"
    tolerated_topics: Tuple[str, ...] = ()

    def platform(self, name: str) -> Platform:
        """Return a platform by its name.

        Raises:
            KeyError: There is none.
        """
        found = {each.name: each for each in self.platforms}
        return found[name]

    def groups_of(self, platform: str) -> Tuple[TopicGroup, ...]:
        """Return the groups that a platform records, in its order."""
        groups = {group.name: group for group in self.groups}
        return tuple(groups[name] for name in self.platform(platform).groups)

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
    ("chunk_kb", Whole(1, 65536), "size of a chunk; left out: 768, with lz4 64", "compressed, it is what a kill or a power cut loses; an image larger than a chunk stays compressed when recordings are merged"),
    ("buffer_mb", Whole(0, 65536), "what rosbag may hold in memory; 0: no limit", "a slow disk shows here"),
    ("split_mb", Whole(0, 1048576), "size at which a bag is closed and the next begun; 0: never", "some file systems take no large files"),
    ("reserve_mb", Whole(0, 1048576), "free space at which rosbag stops to write", "bags must be closed, and others write too"),
)
_TRANSFER_ROWS: Tuple[Row, ...] = (
    ("by", Choice(("rsync", "shared", "here")), "rsync over ssh, from a folder that is mounted here (shared), or used in place (here)", "ssh needs no server but the one that is there"),
    ("host", Text("name or user@name of a computer", r"[A-Za-z0-9_][A-Za-z0-9_.@:-]*|"), "the other computer, for rsync", "as ssh knows it"),
    ("ssh_port", Whole(1, 65535), "of its ssh server", ""),
    ("ssh_key", Text("a file", r"[^\x00-\x1f\x7f]*"), "private key; empty: as ssh is configured", "it must open without a passphrase"),
    ("mount", Text("a folder", r"[^\x00-\x1f\x7f]*"), "where its recordings are mounted, for shared; empty: under the same path", ""),
    ("bandwidth_mb_s", Number(minimum=0.0, maximum=100000.0), "the most that rsync may take of the network; 0: all", ""),
    ("stall_limit_ns", Number(minimum=1.0, maximum=600.0), "a connection that moves nothing for so long is given up and made anew", "a network that was cut does not say so"),
    ("limit_ns", Number(above=0.0, maximum=86400.0), "time in which everything must be here", "an hour of cameras over Gigabit takes 15 minutes"),
)
# fmt: on
_NAME = Text("the name of a platform")  # a bad one is refused where the platform is
_TOPIC = Text('the name of a topic, e.g. "/lrf/range"; "~" stands for the autonomy node', TOPIC_NAME)
_PATTERN = Pattern("a regular expression of topic names")
_GROUP = Group(
    "a group of topics",
    (
        Key("topics", ListOf(_TOPIC, "topics", 1, unique=True), "recorded into one bag"),
        Key(
            "match",
            ListOf(_PATTERN, "regular expressions"),
            "topics that one of them matches are recorded, too",
            "",
            [],
        ),
        bind(
            TopicGroup,
            "exclude",
            _PATTERN,
            "topics that it matches are not recorded, when match is used; none of topics may be among them",
        ),
        bind(TopicGroup, "compression", Choice(("none", "lz4")), "of the chunks; left out: as storage says"),
        bind(TopicGroup, "chunk_kb", Whole(1, 65536), "size of a chunk; left out: as storage says"),
        bind(TopicGroup, "buffer_mb", Whole(0, 65536), "what rosbag may hold in memory; left out: as storage says"),
        bind(
            TopicGroup,
            "expected_mb_s",
            Number(minimum=0.0, maximum=10000.0),
            "what it writes, for the space that a mission needs",
            "measured: amaze-bag info of a flight",
        ),
    ),
)
_PLATFORM = Group(
    "a companion computer",
    (
        Key("groups", ListOf(Text("the name of a group"), "groups", 1, unique=True), "what it records"),
        Key(
            "transfer",
            group_of(Transfer, "a transfer", _TRANSFER_ROWS),
            "how the collector gets its recordings; the collector itself needs none",
            "",
            {},
        ),
    ),
)
_FOLDER = Text('a whole path of a folder, or one in the home, e.g. "~/recordings"', r"~?/[^\x00-\x1f\x7f]*")

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
        bind(
            Recording,
            "start_limit_ns",
            Number(above=0.0, maximum=600.0),
            "time in which every platform must prove that it records",
            "less than recording_start_limit_s, so that the recorder can say what is missing",
        ),
        bind(
            Recording,
            "platform_limit_ns",
            Number(above=0.5, maximum=60.0),
            "a platform whose status is older is silent",
            "ten statuses; WLAN has gaps",
        ),
        bind(
            Recording,
            "keep_parts",
            Flag(),
            "whether the parts are kept after the complete recording is verified",
            "on every platform; nothing is ever removed before that",
        ),
        bind(
            Recording,
            "apply_clock_offset",
            Flag(),
            "whether a merge corrects the record times of other platforms by the measured offsets",
            "measured and written down in any case; header stamps are left alone",
        ),
        bind(
            Recording,
            "duplicates",
            Choice(("count", "drop", "ignore")),
            "what a merge does about messages that two platforms recorded",
            "topics are recorded once; this is for match",
        ),
        bind(
            Recording,
            "tolerated_topics",
            ListOf(_TOPIC, "topics", unique=True),
            "topics of which messages may be lost, and the data of a flight is complete still",
            "a loss is named in any case; of a group, all topics must be tolerated for its gaps",
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
