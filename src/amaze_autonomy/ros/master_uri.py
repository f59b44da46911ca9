"""Where the master is to be: of an address that none can have, rospy says for ever that it may not be running yet."""

from __future__ import annotations

from urllib.parse import urlsplit

import rosgraph

from .errors import StartError


def check_master_uri() -> None:
    """Look at ROS_MASTER_URI.

    Raises:
        StartError: No master can be reached under it.
    """
    try:
        uri = str(rosgraph.get_master_uri())  # a word __master:=URI is before the environment
    except ValueError as error:
        raise StartError(str(error)) from error
    if not _usable(uri):
        raise StartError(f"ROS_MASTER_URI is {uri!r}; must be http://HOST:PORT")


def _usable(uri: str) -> bool:
    """Return whether an address is one of a host; without a port it is the one of HTTP."""
    try:
        parts = urlsplit(uri)
        return parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:  # the port is no number
        return False
