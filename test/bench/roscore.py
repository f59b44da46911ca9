"""A roscore of one's own, on a free port, for as long as a `with` block lasts."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import tempfile
import time
from typing import Optional
from xmlrpc.client import ServerProxy


class Roscore:
    """Starts a roscore and points this process and its children to it."""

    def __init__(self) -> None:
        self._process: Optional[subprocess.Popen[bytes]] = None
        self._home = tempfile.TemporaryDirectory(prefix="amaze_bench_")

    def __enter__(self) -> str:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        os.environ.update(ROS_MASTER_URI=f"http://127.0.0.1:{port}", ROS_IP="127.0.0.1", ROS_HOME=self._home.name)
        command = ["roscore", "-p", str(port)]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 20.0
        while True:
            try:
                ServerProxy(os.environ["ROS_MASTER_URI"]).getPid("/bench")
            except OSError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.05)
            else:
                return self._home.name

    def __exit__(self, *_: object) -> None:
        assert self._process is not None
        self._process.send_signal(signal.SIGINT)
        self._process.wait(20.0)
        self._home.cleanup()
