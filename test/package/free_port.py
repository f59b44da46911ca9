"""Print a TCP port that is free: the one given, if it is, or any."""

import socket
import sys

for port in [*map(int, sys.argv[1:]), 0]:
    with socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            server.bind(("", port))
        except OSError:
            continue
        print(server.getsockname()[1])
        break
