"""Commands of the engine -> service calls -> replies. A call never keeps the engine waiting.

The engine's thread itself sends a request when a connection is open, which takes some ten microseconds; everything that
can wait (connecting, the answer) is a worker's business. Whatever happens, each request ends as exactly one `Reply` or
`CheckReply`, at the latest when its limit is over.
"""

from __future__ import annotations

import os
import time
from functools import partial
from typing import Any, Callable, Dict, Mapping, Tuple

from amaze_autonomy.engine import commands
from amaze_autonomy.engine.events import CheckReply, Event, Outcome, Reply
from amaze_autonomy.interface import InvalidMessageError
from amaze_autonomy.ros.clock import Workers

from ...ros.errors import BrokenCallError, CallTimeoutError, UnavailableError
from ...ros.interface import request_of
from ...ros.service_client import ServiceClient

__all__ = ["Requests"]

_KEEP_LIMIT_S = 0.5


class Requests:
    """Carry out requests to peers.

    Args:
        clients: of all services, by their default names.
        put: takes the replies; called on workers.
        now_ns: the clock that decides.
    """

    def __init__(
        self, clients: Mapping[str, ServiceClient], put: Callable[[Event], None], now_ns: Callable[[], int]
    ) -> None:
        self._clients, self._put, self._now_ns = clients, put, now_ns
        self._workers = Workers("call")
        self._workers.prepare(4)
        self._keeping = False
        self.open: Dict[int, commands.Request] = {}

    def send(self, command: commands.Request) -> None:
        """Send a request, or have a worker connect and send it. Returns at once."""
        service, request = request_of(command)
        client = self._clients[service.name]
        deadline_s = time.monotonic() + command.limit_ns * 1e-9
        data = client.serialize(request)
        connection = client.send_now(data)
        os.sched_yield()  # a peer that was woken on this core goes first: what follows here can wait
        self.open[command.id] = command
        if connection is None:
            self._workers.submit(partial(self._finish, command, partial(client.call, data, deadline_s)))
        else:
            self._workers.submit(partial(self._finish, command, partial(client.finish, connection, deadline_s)))

    def _finish(self, command: commands.Request, wait: Callable[[], Any]) -> None:
        reply = self._reply(command, wait)
        self.open.pop(command.id, None)
        self._put(reply)

    def _reply(self, command: commands.Request, wait: Callable[[], Any]) -> Event:
        try:
            return self._read(command, wait())
        except UnavailableError as error:
            return self._failed(command, Outcome.UNAVAILABLE, str(error))
        except CallTimeoutError as error:
            return self._failed(command, Outcome.TIMED_OUT, str(error))
        except (BrokenCallError, InvalidMessageError) as error:
            return self._failed(command, Outcome.BROKEN, str(error))
        except Exception as error:  # a request without a reply would be a wait without an end
            return self._failed(command, Outcome.BROKEN, f"{type(error).__name__}: {error}")

    def _read(self, command: commands.Request, response: Any) -> Event:
        return request_of(command)[0].reply(response, command.id, self._now_ns())

    def _failed(self, command: commands.Request, outcome: Outcome, message: str) -> Event:
        text = f"{request_of(command)[0].name}: {message}"
        if isinstance(command, commands.RunCheck):
            return CheckReply(
                t_ns=self._now_ns(), command_id=command.id, check=command.check, outcome=outcome, message=text
            )
        return Reply(t_ns=self._now_ns(), command_id=command.id, outcome=outcome, message=text)

    def missing(self, limit_s: float) -> Tuple[str, ...]:
        """Return the services that nobody offers; asks the master, and waits for it."""
        return tuple(client.name for client in self._clients.values() if not client.is_offered(limit_s))

    def keep_connected(self) -> None:
        """Open what is needed in a hurry ahead of time, and again when a peer was restarted. Returns at once."""
        if not self._keeping:
            self._keeping = True
            self._workers.submit(self._keep)

    def _keep(self) -> None:
        try:
            for client in self._clients.values():
                if client.spare:
                    client.keep(_KEEP_LIMIT_S)
        finally:
            self._keeping = False

    def close(self) -> None:
        """Close all idle connections."""
        for client in self._clients.values():
            client.close()
