"""The server of the operator's page: files, and one web socket for each viewer. It knows no ROS.

What goes out, as JSON: what a viewer lacks (`Board.since`), at once when there is something and once a second anyway,
with `beat`, the server's time; and `answers`. A viewer that reads slowly gets less often what has changed meanwhile,
never a queue. What comes in: `have` (the numbers that it has), `token`, and `order`.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import secrets
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Set, Tuple
from urllib.parse import urlsplit

from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from ...console.link import AnswerCame, Happening
from ...console.model import Request, RequestKind
from ...missions import MissionPlan
from .board import Board, Have, Orders

PAGE = Path(__file__).parent / "page"
_BEAT_S = 1.0
_LONGEST_MESSAGE = 1 << 14
_NO_BODIES = {"max_header_size": 1 << 14, "max_body_size": 1}  # tornado parses forms before it asks us; 0: 100 MB
_MOST_VIEWERS = 32
_LEAST_TOKEN = 8
_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "worker-src 'self'; connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}
_log = logging.getLogger(__name__)


def plotly_file() -> Optional[Path]:
    """Return plotly's script where the library is installed (`pip install amaze_autonomy[page]`), else None."""
    found = find_spec("plotly")
    if found is None or found.origin is None:
        return None
    path = Path(found.origin).parent / "package_data" / "plotly.min.js"
    return path if path.is_file() else None


def token_of(file: Path) -> str:
    """Return the token of a file; make one where there is none.

    Raises:
        OSError: It can neither be read nor be made.
        ValueError: It is too short.
    """
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        file.parent.mkdir(parents=True, exist_ok=True)
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as out:
            lines = [secrets.token_urlsafe(12)]
            out.write(lines[0] + "\n")
    token = lines[0].strip() if lines else ""
    if len(token) < _LEAST_TOKEN:
        raise ValueError(f"{file}: must begin with a token of at least {_LEAST_TOKEN} characters")
    return token


class PageServer:
    """Serves the page; everything but `post` belongs to the thread that runs the loop.

    Args:
        token: without it nobody commands.
        plans: the missions, to be drawn.
        send: sends a request to the engine; its answer is posted.
        now: the time, in seconds.
    """

    def __init__(
        self,
        token: str,
        plans: Sequence[MissionPlan] = (),
        send: Callable[[Request], None] = lambda _: None,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        board_id = secrets.token_hex(8)
        self.board, self.orders = Board(board_id, plans), Orders(board_id, token)
        self.send, self.now = send, now
        self.viewers: Set[Viewer] = set()
        self._loop: Optional[IOLoop] = None
        self._server: Optional[HTTPServer] = None
        self._lists = 0

    def listen(self, port: int, address: str = "127.0.0.1") -> Tuple[str, int]:
        """Wait for viewers on the present loop; return address and port, which is a free one for 0.

        Raises:
            OSError: The port is in use, or the address is not one of this computer.
        """
        self._loop = IOLoop.current()
        self._server = HTTPServer(self.application(loopback=address in _LOOPBACK), **_NO_BODIES)
        self._server.listen(port, address)
        self._loop.call_later(_BEAT_S, self._beat)
        sockets = self._server._sockets.values()  # the only way to a port that was free
        return address, next(iter(sockets)).getsockname()[1]

    def application(self, *, loopback: bool) -> Application:
        """Return what answers; on the loopback only under its own names, so that no other site can point one at it."""
        given = {"server": self, "loopback": loopback}
        plotly = plotly_file()
        scripts = [(r"/(plotly\.min\.js)", _File, {**given, "path": str(plotly.parent)})] if plotly else []
        return Application(
            [
                (r"/", _Index, given),
                (r"/stream", Viewer, given),
                (r"/(page\.js|clock\.js|page\.css)", _File, {**given, "path": str(PAGE)}),
                *scripts,
            ],
            websocket_ping_interval=5,
            websocket_max_message_size=_LONGEST_MESSAGE,
        )

    def close(self) -> None:
        """Let all viewers go."""
        if self._server is not None:
            self._server.stop()
        for viewer in tuple(self.viewers):
            viewer.close(1001, "the page's server ends")

    def post(self, happening: Happening) -> None:
        """Take in what has happened; from any thread."""
        if self._loop is not None:
            self._loop.add_callback(self.take, happening)

    def take(self, happening: Happening) -> None:
        """Take in what has happened."""
        if isinstance(happening, AnswerCame):
            answer = self.orders.answered(happening)
            self._tell([] if answer is None else [answer])
            return
        self.board.take(happening, self.now())
        if self.board.wants_missions(self.now()):
            self._lists += 1
            self.send(Request(RequestKind.LIST, self._lists))
        self._tell([])

    def _tell(self, answers: List[Dict[str, str]]) -> None:
        for viewer in self.viewers:
            viewer.tell(answers)

    def _beat(self) -> None:
        self._tell(self.orders.overdue(self.now()))
        if self._loop is not None:
            self._loop.call_later(_BEAT_S, self._beat)


class _Guarded(RequestHandler):
    """What all answers have in common."""

    def initialize(self, server: PageServer, loopback: bool, **_: Any) -> None:  # noqa: FBT001 - tornado's
        self.server, self.loopback = server, loopback

    def set_default_headers(self) -> None:
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        if self.loopback and urlsplit(f"//{self.request.host}").hostname not in _LOOPBACK:
            raise HTTPError(403, "this page is for this computer only")


class _Index(_Guarded):
    def get(self) -> None:
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.finish((PAGE / "index.html").read_bytes())


class _File(_Guarded, StaticFileHandler):
    def initialize(self, server: PageServer, loopback: bool, **folder: Any) -> None:  # noqa: FBT001
        _Guarded.initialize(self, server, loopback)
        StaticFileHandler.initialize(self, **folder)


class Viewer(_Guarded, WebSocketHandler):
    """One page that is open somewhere."""

    def open(self, *_: str, **__: str) -> None:
        """Begin to tell; the first thing that it says is what it has."""
        self._have: Optional[Have] = None
        self._answers: Dict[str, Dict[str, str]] = {}
        self._changed = asyncio.Event()
        if len(self.server.viewers) >= _MOST_VIEWERS:
            self.close(1013, "too many viewers")
            return
        self.server.viewers.add(self)
        IOLoop.current().add_callback(self._run)

    def on_close(self) -> None:
        """Forget it."""
        self.server.viewers.discard(self)
        self._changed.set()

    def tell(self, answers: Sequence[Dict[str, str]]) -> None:
        """Have it look at what is new."""
        self._answers.update({each["id"]: each for each in answers})
        self._changed.set()

    async def _run(self) -> None:
        """Send what is new, one message at a time: the next one when the last one is on its way."""
        try:
            while self in self.server.viewers:
                await self._changed.wait()
                self._changed.clear()
                if self._have is not None:
                    await self.write_message(self._news(self._have))
        except WebSocketClosedError:
            self.server.viewers.discard(self)

    def _news(self, have: Have) -> str:
        now_s = self.server.now()
        news, self._have = self.server.board.since(have, now_s)
        answers, self._answers = self._answers, {}
        viewers = len(self.server.viewers)
        return json.dumps({**news, "beat": now_s, "viewers": viewers, "answers": list(answers.values())})

    def on_message(self, message: Any) -> None:
        """Take in what the page says; what is not understood is not answered."""
        try:
            said = json.loads(message)
        except ValueError:
            said = None
        if not isinstance(said, dict):
            self.close(1003, "not understood")
            return
        if "have" in said:
            self._have = _have_of(said["have"])
            self._changed.set()
        if "token" in said:
            self.write_message(json.dumps({"token": self.server.orders.knows(said["token"])}))
        if isinstance(said.get("order"), dict):
            self._order(said["order"])

    def _order(self, order: Dict[str, Any]) -> None:
        server, now_s = self.server, self.server.now()
        answer, request = server.orders.take(order, server.board.state_at(now_s), now_s)
        if request is not None:
            _log.warning("%s asks for: %s", self.request.remote_ip, request.words)
            server.send(request)
        if answer is not None:
            self.tell([answer])


def _have_of(said: Any) -> Have:
    """Return what a page says that it has; nonsense is nothing."""
    if not isinstance(said, dict):
        return Have()
    note, sample = (said.get(name) if isinstance(said.get(name), int) else 0 for name in ("note", "sample"))
    return Have(board=str(said.get("board", "")), run=str(said.get("run", "")), note=note or 0, sample=sample or 0)
