"""The node of the operator's page: connects the server with the engine, as a console does.

    web [--address ADDRESS] [--port PORT] [--token-file FILE] [--config FOLDER] [--overrides "file.key=value; ..."]

Topics, services and parameters: `console/ros_link.py`. The token is the first line of its file, which is made, for its
owner alone, where there is none; it is printed with the address.
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from pathlib import Path
from typing import List, Optional, Sequence
from urllib.parse import quote

import rospkg
from tornado.ioloop import IOLoop

from amaze_autonomy.config import ConfigError, load_configuration
from amaze_autonomy.paths import config_folder

from ...console.link import Happening, LinkClosed
from ...console.ros_link import RosLink
from .server import PageServer, token_of

__all__ = ["main"]

_ERROR = 2


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Serve the page until the node is told to end; return the exit status."""
    options = _parser().parse_args([each for each in (arguments or sys.argv[1:]) if ":=" not in each])
    overrides: List[str] = [each.strip() for each in options.overrides.split(";") if each.strip()]
    file = options.token_file or Path(rospkg.get_ros_home()) / "amaze_autonomy" / "web_token"
    try:
        token = token_of(Path(file).expanduser())
        plans = load_configuration(options.config or config_folder(), overrides).plans
        return _serve(options.address, options.port, token, plans)
    except (ConfigError, OSError, ValueError) as error:
        print(f"web: {error}", file=sys.stderr, flush=True)
        return _ERROR


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="web", description="Serves the operator's page.")
    parser.add_argument("--address", default="127.0.0.1", help="of this computer, that it is reached at")
    parser.add_argument("--port", type=int, default=8080, help="0: any that is free")
    parser.add_argument("--token-file", default="", help="file whose first line allows commands; made if there is none")
    parser.add_argument("--config", default="", help="folder of the configuration; default: the one that ships")
    parser.add_argument("--overrides", default="", help="keys that are to be different, semicolons between")
    return parser


def _serve(address: str, port: int, token: str, plans: Sequence[object]) -> int:
    loop, ended = IOLoop.current(), threading.Event()
    server = PageServer(token, plans)  # type: ignore[arg-type]

    def post(happening: Happening) -> None:
        if isinstance(happening, LinkClosed):
            ended.set()
            loop.add_callback(loop.stop)
        else:
            server.post(happening)

    link = RosLink(post, None, quiet=False)
    server.send = link.send
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
    host, at = server.listen(port, address)
    name = f"[{host}]" if ":" in host else host
    print(f"web: the operator's page: http://{name}:{at}/#{quote(token)}", flush=True)
    print("web: who has the address with what follows # may command; without it one only looks", flush=True)
    link.start()
    try:
        loop.start()
    finally:
        server.close()
        link.close()
    return 0
