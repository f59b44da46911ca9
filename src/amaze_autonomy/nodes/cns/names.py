"""The names and types that one of the two nodes of this folder speaks of: those of the peers that it is started with.

Both have the parameter ~cns_namespace, which their names are in, e.g. /cns; empty: as they are.
"""

from __future__ import annotations

import importlib
from typing import Any, Dict, List, Mapping

import rospy

from amaze_autonomy.cns.tables import PEERS, SERVICES, TOPICS, Name

from ...ros.errors import StartError


class Names:
    """Topics and services of some peers, in their namespace.

    Args:
        parameter: of this node, which names the peers with commas between; empty: all five.

    Attributes:
        peers: the names of ours.
        topics: theirs, by key.
        services: theirs, by key.
        classes: of messages and services, by key.

    Raises:
        StartError: the parameter is wrong, or a message of theirs is missing or another one.
    """

    def __init__(self, parameter: str) -> None:
        given = str(rospy.get_param(f"~{parameter}", "")).replace(" ", "")
        self.peers = tuple(given.split(",")) if given else PEERS
        for name in self.peers:
            if name not in PEERS:
                raise StartError(f"~{parameter} has {name!r}, must be some of {', '.join(PEERS)}")
        self._prefix = str(rospy.get_param("~cns_namespace", "")).rstrip("/")
        self.topics = {key: name for key, name in TOPICS.items() if name.peer in self.peers}
        self.services = {key: name for key, name in SERVICES.items() if name.peer in self.peers}
        self.classes = cns_classes({**self.topics, **self.services}, self.services)

    def resolved(self, name: Name) -> str:
        """Return it in their namespace, which is in this node's where it has no slash in front."""
        return str(rospy.resolve_name(self._prefix + name.name))


def cns_classes(names: Mapping[str, Name], services: Mapping[str, Name]) -> Dict[str, Any]:
    """Return the classes of messages and services.

    Raises:
        StartError: with everything that is missing, by package, or is another type under the same name.
    """
    found: Dict[str, Any] = {}
    problems: List[str] = []
    for key, name in names.items():
        package, kind = name.type.split("/")
        try:
            found[key] = getattr(importlib.import_module(f"{package}.{'srv' if key in services else 'msg'}"), kind)
        except (ImportError, AttributeError):
            problems.append(f"{name.type} is missing: build the package {package} in your workspace and source it")
            continue
        if found[key]._md5sum != name.md5:
            problems.append(f"{name.type} has the md5 sum {found[key]._md5sum}, must be {name.md5}: another version")
    if problems:
        raise StartError("; ".join(dict.fromkeys(problems)))
    return found
