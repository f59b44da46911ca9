"""What the collector's node does to files: the journal and the configuration into the session."""

from __future__ import annotations

import os
import shutil
import threading
from pathlib import Path
from typing import Any, Dict, Mapping

import rospy

from amaze_autonomy.config import Configuration
from amaze_autonomy.config.recording_schema import Transfer
from amaze_autonomy.recording import Collector, RecordingError
from amaze_autonomy.recording.collector import correction_ns
from amaze_autonomy.recording.storage import write_json

__all__ = ["Collection"]

_JOURNAL = "journal.jsonl"


class Collection:
    """Files of the collector.

    Args:
        configuration: as loaded.
        transfers: how each platform's part is fetched.
    """

    def __init__(self, configuration: Configuration, transfers: Mapping[str, Transfer]) -> None:
        self._configuration, self.transfers = configuration, transfers
        self._copying = threading.Lock()

    def request(self, folder: Path, collector: Collector) -> Dict[str, Any]:
        """Return what the job shall do that makes one recording of all parts."""
        sources = [self._source(folder, collector, name) for name, view in collector.views.items() if view.began]
        return {
            "do": "collect",
            "output": str(folder / f"{folder.name}.bag"),
            "sources": sources,
            "duplicates": self._configuration.recording.duplicates,
            "facts": {
                "session_id": collector.session_id,
                "mission_id": collector.mission_id,
                "stopped_ns": collector.stopped_ns,
                "configuration_hash": self._configuration.hash,
            },
        }

    def _source(self, folder: Path, collector: Collector, name: str) -> Dict[str, Any]:
        view, own = collector.views[name], name == collector.setup.own
        in_place = own or self.transfers[name].by == "here"
        correction = correction_ns(view.offsets.get("start"), view.offsets.get("stop"))
        return {
            "platform": name,
            "folder": view.part.location if in_place else str(folder / name),
            "fetched": not in_place,
            "correction_ns": correction if self._configuration.recording.apply_clock_offset else 0,
            "clock": {when: offset.as_json() for when, offset in sorted(view.offsets.items())},
        }

    def copy_journal(self, folder: Path, *, again: bool = False) -> None:
        """Copy the engine's journal, as far as it is written, and its configuration into a session."""
        journal = str(rospy.get_param("~journal", "")) or str(rospy.get_param("autonomy/journal_file", ""))
        try:
            with self._copying:
                if journal and Path(journal).is_file():
                    _copy(Path(journal), folder / _JOURNAL)
                if not again:
                    self._copy_configuration(folder / "configuration")
        except (OSError, RecordingError) as error:
            rospy.logwarn("the journal could not be copied into the session: %s", error)

    def _copy_configuration(self, target: Path) -> None:
        source = self._configuration.folder
        for path in [*sorted(source.glob("*.yaml")), *sorted((source / "trajectories").rglob("*"))]:
            if path.is_file():
                place = target / path.relative_to(source)
                place.parent.mkdir(parents=True, exist_ok=True)
                _copy(path, place)
        write_json(target / "effective.json", self._configuration.effective)


def _copy(source: Path, target: Path) -> None:
    """Copy a file so that the target is the old one or the new one."""
    half = target.with_name(f".{target.name}.part")
    shutil.copyfile(source, half)
    with half.open("rb") as file:
        os.fsync(file.fileno())
    half.replace(target)
