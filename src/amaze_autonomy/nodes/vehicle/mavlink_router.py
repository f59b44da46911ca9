"""Starts mavlink-router, which shares the autopilot's serial port among the links of autopilot.yaml.

    mavlink_router DEVICE[:BAUD] [--config FOLDER] [--overrides "FILE.KEY=VALUE; ..."]

It becomes `mavlink-routerd` (https://github.com/mavlink-router/mavlink-router) with an endpoint for each udpin: URL of
`link` and `planner_link`. ROS arguments (name:=value) are left alone.
"""

from __future__ import annotations

import ipaddress
import os
import shutil
import socket
import sys
from typing import List

from amaze_autonomy.config import AutopilotSettings, ConfigError, load_configuration

from ...config.errors import EndpointError
from ...config.kinds import Endpoint, EndpointKind, parse_endpoint
from ...ros.arguments import answer_words, configuration_folder, overrides, read_words

PROGRAM = "mavlink-routerd"
_ERROR = 2
_PLACES = ("device",)
_OURSELVES = {4: "127.0.0.1", 6: "::1"}


def arguments_of(device: str, settings: AutopilotSettings) -> List[str]:
    """Return the command line of the router.

    Raises:
        EndpointError: The device is none, or a link does not wait on UDP at an address that a router takes.
    """
    serial = parse_endpoint(f"serial:{device}")
    command = [PROGRAM, "-t", "0"]  # no TCP server
    for link in (settings.link, settings.planner_link):
        endpoint = parse_endpoint(link.url)
        if endpoint.kind is not EndpointKind.UDP_IN:
            right = "must be udpin:HOST:PORT, where the router sends to"
            raise EndpointError(link.url, "cannot be reached by a router", right)
        command += ["-e", f"{_host(link.url, endpoint)}:{endpoint.number}"]
    return [*command, f"{serial.address}:{serial.number}"]


def _host(url: str, endpoint: Endpoint) -> str:
    """Return where a link waits, as a router takes it: it looks up no names, and has IPv6 in brackets.

    `localhost` is looked up as the link does; where a link listens everywhere, this computer is one of the places.
    """
    try:
        name, number = endpoint.address, endpoint.number
        if name.lower() == "localhost":
            name = str(socket.getaddrinfo(name, number, type=socket.SOCK_DGRAM)[0][4][0])
        address = ipaddress.ip_address(name)
    except (OSError, ValueError):
        right = "must be udpin:ADDRESS:PORT, the address in numbers or localhost: mavlink-router looks up no names"
        raise EndpointError(url, "names a host that a router cannot send to", right) from None
    host = _OURSELVES[address.version] if address.is_unspecified else str(address)
    return f"[{host}]" if address.version == 6 else host  # noqa: PLR2004 - of IPv6


def main() -> int:
    """Become the router; return an exit status only when that fails."""
    answered = answer_words("mavlink_router", __doc__, places=_PLACES)
    if answered is not None:
        return answered
    device = read_words("mavlink_router", sys.argv[1:], *_PLACES)["device"]
    try:
        configuration = load_configuration(configuration_folder(), overrides())
        command = arguments_of(device, configuration.autopilot)
    except (ConfigError, EndpointError) as error:
        return _refuse(str(error))
    program = shutil.which(PROGRAM)
    if program is None:
        return _refuse(f"{PROGRAM} is not installed; build it from https://github.com/mavlink-router/mavlink-router")
    sys.stderr.write(f"mavlink_router: {' '.join(command)}\n")
    sys.stderr.flush()
    os.execv(program, command)  # noqa: S606 - a list, no shell
    return _ERROR


def _refuse(words: str) -> int:
    sys.stderr.write(f"mavlink_router: {words}\n")
    return _ERROR
