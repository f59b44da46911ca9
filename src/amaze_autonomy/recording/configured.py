"""What the recorders of a platform are told to record, and what another copy of the configuration lacks of it.

Each computer has a copy of the configuration, and records by its own. The list of a part says what its recorders were
told (`configured`, of each group); the collector compares that with what its own copy says of that platform.
"""

from __future__ import annotations

import re
from contextlib import suppress
from typing import Any, List, Mapping, Optional, Sequence, Tuple

Configured = Mapping[str, Any]  # topics, match and exclude of a group, as JSON holds them
_ALL = ".*"


def configured(topics: Sequence[str], match: Sequence[str] = (), exclude: str = "") -> Configured:
    """Return what the recorder of a group is told; its topics are resolved. It excludes from what it matches alone."""
    return {"topics": list(topics), "match": list(match), "exclude": exclude if match else ""}


def common(one: Configured, other: Configured) -> Configured:
    """Return what both record: so much was recorded all the time where the second one came after the first."""
    topics, match = ([each for each in one[key] if each in other[key]] for key in ("topics", "match"))
    excluded = sorted({one["exclude"], other["exclude"]} - {""})
    return configured(topics, match, "|".join(excluded))


def lacking(content: Mapping[str, Any], wanted: Mapping[str, Configured]) -> Tuple[List[str], List[str]]:
    """Return the topics and the expressions that were wanted of a part and that its recorders were not told.

    What two expressions have in common nobody can tell: they are compared as they are written. A list that does not say
    what its recorders were told, as an own recorder's that names files alone, tells nothing.

    Args:
        content: the list of the part.
        wanted: the groups of its platform in the collector's configuration.
    """
    there = _groups(content)
    if there is None:
        return [], []
    topics = [topic for each in wanted.values() for topic in each["topics"]]
    expressions = [
        f"{pattern} (without {each['exclude']})" if each["exclude"] else str(pattern)
        for each in wanted.values()
        for pattern in each["match"]
        if not any(_matches_as_much(group, pattern, each["exclude"]) for group in there)
    ]
    return [topic for topic in topics if not any(_records(group, topic) for group in there)], expressions


def _groups(content: Mapping[str, Any]) -> Optional[List[Configured]]:
    """Return the groups that the list of a part has; None: it has none, or what cannot be one."""
    with suppress(KeyError, TypeError, AttributeError):
        return [
            configured([*map(str, each["topics"])], [*map(str, each["match"])], str(each["exclude"]))
            for each in content["configured"].values()
        ]
    return None


def _records(group: Configured, topic: str) -> bool:
    """Return whether a group records a topic; rosbag looks at what is excluded first."""
    if _matches(group["exclude"], topic):
        return False
    return topic in group["topics"] or any(_matches(pattern, topic) for pattern in group["match"])


def _matches(pattern: str, topic: str) -> bool:
    with suppress(re.error):
        return re.fullmatch(pattern, topic) is not None
    return False


def _matches_as_much(group: Configured, pattern: str, exclude: str) -> bool:
    return group["exclude"] in ("", exclude) and bool({pattern, _ALL} & set(group["match"]))
