"""The node of the operator's page: connects the server with the engine, as a console does.

Words: `arguments.py`. Topics, services and parameters: `console/ros_link.py`. The token is the first line of its file,
which is made, for its owner alone, where there is none; it is printed with the address.
"""

from __future__ import annotations

import errno
import signal
import sys
from pathlib import Path
from typing import List, Sequence, Tuple
from urllib.parse import quote

import rospkg
from tornado.ioloop import IOLoop

from amaze_autonomy.config import ConfigError, load_configuration

from ...console.link import Happening, LinkClosed
from ...console.ros_link import RosLink
from ...paths import expanded
from ...ros.arguments import answer_words, configuration_folder, given, overrides
from ...ros.errors import StartError
from ...ros.node_main import write_for_user_and_group
from .server import PageServer, token_of

_ERROR = 2
_LAST_PORT = 65535
_OF_THE_PORT = (errno.EADDRINUSE, errno.EACCES)


def main() -> int:
    """Serve the page until the node is told to end; return the exit status."""
    answered = answer_words("web", __doc__)
    if answered is not None:
        return answered
    write_for_user_and_group()  # the folder of the token is that of the runs
    file = given("token_file") or Path(rospkg.get_ros_home()) / "amaze_autonomy" / "web_token"
    try:
        token = token_of(expanded(str(file)))
        plans = load_configuration(configuration_folder(), overrides()).plans
        return _serve(given("address"), _port(), token, plans)
    except (ConfigError, StartError, OSError, ValueError) as error:
        print(f"web: {error}", file=sys.stderr, flush=True)
        return _ERROR


def _port() -> int:
    if not given("port").isdecimal() or int(given("port")) > _LAST_PORT:
        raise StartError(f"--port is {given('port')!r}, must be a number, 0 to {_LAST_PORT}")
    return int(given("port"))


def listen(server: PageServer, address: str, port: int) -> Tuple[str, int]:
    """Let the server wait there; return address and port.

    Raises:
        StartError: It cannot; says which of the two it is.
    """
    try:
        return server.listen(port, address)
    except UnicodeError as error:  # of a name that no resolver can be asked for
        raise StartError(f"--address {address}: is no address of this computer") from error
    except OSError as error:
        words = error.strerror or str(error)
        told = f"--port {port}" if error.errno in _OF_THE_PORT else f"--address {address}"
        raise StartError(f"{told}: {words}") from error


def _serve(address: str, port: int, token: str, plans: Sequence[object]) -> int:
    loop = IOLoop.current()
    closed: List[LinkClosed] = []
    server = PageServer(token, plans)  # type: ignore[arg-type]

    def post(happening: Happening) -> None:
        if isinstance(happening, LinkClosed):
            closed.append(happening)
            loop.add_callback(loop.stop)
        else:
            server.post(happening)

    link = RosLink(post, None, quiet=False)
    server.send = link.send
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
    host, at = listen(server, address, port)
    name = f"[{host}]" if ":" in host else host
    print(f"web: the operator's page: http://{name}:{at}/#{quote(token)}", flush=True)
    print("web: who has the address with what follows # may command; without it one only looks", flush=True)
    link.start()
    try:
        loop.start()
    finally:
        server.close()
        link.close()
    if any(each.failed for each in closed):
        raise StartError(closed[0].reason)
    return 0
