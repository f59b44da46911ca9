"""What the recorder node is told: by recording.yaml, its words and its parameters."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Sequence, Tuple, Type

import rospy

from amaze_autonomy.config import Configuration
from amaze_autonomy.config.schemas.recording import Transfer
from amaze_autonomy.paths import expanded
from amaze_autonomy.recording import Answer, CollectorSetup, GroupSetup, PlatformSetup
from amaze_autonomy.recording.status import Configured, configured
from amaze_autonomy.recording.storage import reserve_bytes
from amaze_autonomy.ros.clock import MonotonicClock, Workers

from ...ros.arguments import given
from ...ros.errors import StartError
from .processes import RecorderJobs

_TRANSFERS = ("", "rsync", "shared", "here")


def platform_name(configuration: Configuration) -> str:
    """Return ~platform, or the collector.

    Raises:
        StartError: There is no such platform.
    """
    recording = configuration.recording
    name = str(rospy.get_param("~platform", "")) or recording.collector
    known = [each.name for each in recording.platforms]
    if name not in known:
        raise StartError(f"~platform is {name!r}, recording.yaml has {', '.join(known)}")
    return name


def recordings_folder(configuration: Configuration) -> Path:
    """Return --folder, or that of recording.yaml; it is made.

    Raises:
        StartError: It cannot be made, or is no whole path: the current folder is that of who started the node.
    """
    folder = expanded(given("folder") or configuration.recording.folder)
    if str(folder).startswith("~"):
        raise StartError(f"{folder}: there is no such home; name another one with --folder")
    if not folder.is_absolute():
        raise StartError(f"{folder}: is no whole path; name one with --folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StartError(f"{folder}: cannot be made ({error.strerror}); name another one with --folder") from error
    return folder.resolve()


def transfers(configuration: Configuration) -> Dict[str, Transfer]:
    """Return how the part of each platform is fetched: as --transfer says, or recording.yaml.

    Raises:
        StartError: There is no such way.
    """
    way = given("transfer")
    if way not in _TRANSFERS:
        raise StartError(f"--transfer is {way!r}, must be one of {', '.join(_TRANSFERS[1:])}, or empty")
    known = {each.name: each.transfer for each in configuration.recording.platforms}
    return {name: replace(each, by=way) if way else each for name, each in known.items()}


def resolved(topics: Sequence[str]) -> Tuple[str, ...]:
    """Return names as the recorder takes them; ~ is the autonomy node's private namespace."""
    names = [rospy.resolve_name(name.replace("~", "autonomy/", 1)) for name in topics]
    return tuple(dict.fromkeys(names))


def _group_setups(configuration: Configuration, name: str) -> Tuple[GroupSetup, ...]:
    """Return the groups of a platform, their topics resolved."""
    groups = configuration.recording.groups_of(name)
    return tuple(GroupSetup(each.name, resolved(each.topics), each.match, each.exclude) for each in groups)


def collector_setup(configuration: Configuration) -> CollectorSetup:
    """Return what the collector's machine needs."""
    recording = configuration.recording
    others = [each for each in recording.platforms if each.name != recording.collector]
    return CollectorSetup(
        own=recording.collector,
        platforms=tuple(each.name for each in recording.platforms),
        fetched=tuple(each.name for each in others),
        start_limit_ns=recording.start_limit_ns,
        silent_ns=recording.platform_limit_ns,
        stop_limit_ns=recording.stop_limit_ns,
        transfer_limit_ns=max((each.transfer.limit_ns for each in others), default=0),
        keep_parts=recording.keep_parts,
        wanted=wanted_parts(configuration),
    )


def wanted_parts(configuration: Configuration, *, tolerated: Sequence[str] = ()) -> Dict[str, Dict[str, Configured]]:
    """Return the groups of each platform, as its recorders are told them.

    Args:
        configuration: as loaded.
        tolerated: topics that are left out, as they are written there.
    """
    left_out = frozenset(resolved(tolerated))
    return {
        each.name: {
            group.name: configured([it for it in group.topics if it not in left_out], group.match, group.exclude)
            for group in _group_setups(configuration, each.name)
        }
        for each in configuration.recording.platforms
    }


def platform_setup(configuration: Configuration, name: str) -> PlatformSetup:
    """Return what the machine of a platform needs."""
    recording = configuration.recording
    return PlatformSetup(
        name=name,
        groups=_group_setups(configuration, name),
        growth_limit_ns=recording.growth_limit_ns,
        stop_limit_ns=recording.stop_limit_ns,
        reserve_bytes=reserve_bytes(recording.storage),
    )


# --- recorder share ---------------------------------------------------------------------------------------------------
# What the parts of the recorder node have in common: one lock around both machines, clocks, threads, requests.


@dataclass(frozen=True)
class RecorderShare:
    """Made once per node.

    Args:
        configuration: as loaded.
        folder: of the recordings.
        stamp_ns: the clock that stamps.
        now_ns: the clock of the machines; processes and disks know no simulated time.
        lock: held whenever a machine is asked or told something.
        wake: set when there is something to do before the next turn.
        jobs: processes that work on files.
        workers: threads that wait for them, and for other platforms.
    """

    configuration: Configuration
    folder: Path
    stamp_ns: Callable[[], int]
    now_ns: Callable[[], int] = field(default_factory=lambda: MonotonicClock().now_ns)
    lock: threading.RLock = field(default_factory=threading.RLock)
    wake: threading.Event = field(default_factory=threading.Event)
    jobs: RecorderJobs = field(default_factory=RecorderJobs)
    workers: Workers = field(default_factory=lambda: Workers("recorder"))
    services: List[Any] = field(default_factory=list)

    def serve(self, name: str, service: Type[Any], answer: Callable[[Any], Answer]) -> None:
        """Offer a service that is answered at once; what comes of it is done by the working thread."""

        def handle(request: Any) -> Any:
            given = answer(request)
            self.wake.set()
            return service._response_class(accepted=given.accepted, message=given.message)

        self.services.append(rospy.Service(name, service, handle))
