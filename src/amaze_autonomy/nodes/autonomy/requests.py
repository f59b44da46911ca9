"""Commands of the engine -> service calls -> replies. A call never keeps the engine waiting.

The engine's thread itself sends a request when a connection is open, which takes some ten microseconds; everything that
can wait (connecting, the answer) is a worker's business. Whatever happens, each request ends as exactly one `Reply` or
`CheckReply`, at the latest when its limit is over; one that no worker can take is refused at once.

The workers are there from the start: in flight the system may give no new thread. Landings have their own, so that
none waits behind others, and take those of the others when they need more.
"""

from __future__ import annotations

import logging
import os
import time
from functools import partial
from typing import Any, Callable, Dict, Mapping, Tuple

from amaze_autonomy.engine import commands
from amaze_autonomy.engine.events import CheckReply, Event, Outcome, Reply
from amaze_autonomy.interface import InvalidMessageError
from amaze_autonomy.ros.clock import Workers

from ...ros.errors import BrokenCallError, CallTimeoutError, UnavailableError, report
from ...ros.interface import request_of
from ...ros.service_client import ServiceClient

_log = logging.getLogger(__name__)
_KEEP_LIMIT_S = 0.5
_CALLS = 8  # all checks at once, a command, and who keeps the connections
_LANDINGS = 6  # both routes, every half second, with a second's time for each answer, and one more
_NO_WORKER = (RuntimeError, MemoryError)


def failure(command: commands.Request, outcome: Outcome, message: str, t_ns: int) -> Event:
    """Return the reply to a request that did not end with an answer."""
    text = f"{request_of(command)[0].name}: {message}"
    if isinstance(command, commands.RunCheck):
        return CheckReply(t_ns=t_ns, command_id=command.id, check=command.check, outcome=outcome, message=text)
    return Reply(t_ns=t_ns, command_id=command.id, outcome=outcome, message=text)


def _lands(command: commands.Request) -> bool:
    if isinstance(command, commands.MissionCommand):
        return command.action in (commands.MissionAction.LAND, commands.MissionAction.ABORT)
    return isinstance(command, commands.AutopilotLand)


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
        self._calls, self._landings = Workers("call"), Workers("land")
        self._landings.prepare(_LANDINGS)
        self._calls.prepare(_CALLS)
        self._keeping, self._kept = False, True
        self.open: Dict[int, commands.Request] = {}

    def send(self, command: commands.Request) -> None:
        """Send a request, or have a worker connect and send it. Returns at once.

        Raises:
            RuntimeError: No worker can wait for its answer. It may have gone out. Likewise MemoryError.
        """
        service, request = request_of(command)
        client = self._clients[service.name]
        deadline_s = time.monotonic() + command.limit_ns * 1e-9
        data = client.serialize(request)
        connection = client.send_now(data)
        os.sched_yield()  # a peer that was woken on this core goes first: what follows here can wait
        try:
            self.open[command.id] = command
            if connection is None:
                self._submit(command, partial(client.call, data, deadline_s))
            else:
                self._submit(command, partial(client.finish, connection, deadline_s))
        except _NO_WORKER:
            self.open.pop(command.id, None)
            if connection is not None:
                connection.close()  # its answer would be taken for that of the next request
            raise

    def _submit(self, command: commands.Request, wait: Callable[[], Any]) -> None:
        """Have a worker see a request to its end."""
        job = partial(self._finish, command, wait)
        if not _lands(command):
            self._calls.submit(job)
            return
        try:
            self._landings.submit(job)
        except _NO_WORKER:
            self._calls.submit(job)

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
            report(_log, "the answer to %s could not be taken", request_of(command)[0].name)
            return self._failed(command, Outcome.BROKEN, f"{type(error).__name__}: {error}")

    def _read(self, command: commands.Request, response: Any) -> Event:
        return request_of(command)[0].reply(response, command.id, self._now_ns())

    def _failed(self, command: commands.Request, outcome: Outcome, message: str) -> Event:
        return failure(command, outcome, message, self._now_ns())

    def missing(self, limit_s: float) -> Tuple[str, ...]:
        """Return the services that nobody offers; asks the master, and waits for it."""
        return tuple(client.name for client in self._clients.values() if not client.is_offered(limit_s))

    def keep_connected(self) -> None:
        """Open what is needed in a hurry ahead of time, and again when a peer was restarted. Returns at once."""
        if self._keeping:
            return
        self._keeping = True
        try:
            self._calls.submit(self._keep)
        except _NO_WORKER:
            self._keeping = False
            if self._kept:
                report(_log, "connections cannot be opened ahead of time")
            self._kept = False
        else:
            self._kept = True

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
