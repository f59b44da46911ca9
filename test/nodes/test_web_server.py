"""The server of the operator's page against tornado's client: who is let in, what goes out, what comes in."""

from __future__ import annotations

import asyncio
import json
import re
import socket
import sys
from unittest.mock import Mock

import pytest

pytest.importorskip("tornado")

from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

from amaze_autonomy.console.link import AnswerCame, MessagesCame, StateCame
from amaze_autonomy.console.model import Note, Snapshot, Verdict
from amaze_autonomy.nodes.web.server import PageServer, token_of

pytestmark = pytest.mark.live
LIMIT_S = 60.0
TOKEN = "a token of the vehicle"
READY = StateCame(Snapshot(state="READY", user_commands=("go",)))


def served(story):
    """Run a story with a server and the requests that it sent to the engine."""

    async def whole():
        sent = []
        server = PageServer(TOKEN, send=sent.append)
        _, port = server.listen(0)
        try:
            await asyncio.wait_for(story(server, port, sent), LIMIT_S)
        finally:
            server.close()

    asyncio.run(whole())


async def viewer(port, **said):
    socket = await websocket_connect(f"ws://127.0.0.1:{port}/stream")
    await socket.write_message(json.dumps({"have": {}, **said}))
    return socket


async def wait_for(condition):
    while not condition():  # noqa: ASYNC110 - what is waited for knows nothing of this loop
        await asyncio.sleep(0.01)


async def hear(socket, wanted):
    """Return the first message in which something is, and close nothing."""
    while True:
        news = json.loads(await socket.read_message())
        if wanted(news):
            return news


def test_the_page_loads_nothing_from_elsewhere_and_is_not_for_other_sites():
    async def story(_server, port, _sent):
        client = AsyncHTTPClient()
        for path in ("/", "/page.js", "/clock.js", "/page.css"):
            answer = await client.fetch(f"http://127.0.0.1:{port}{path}")
            assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
            assert not re.search(rb"https?://", answer.body)
        for path in ("/nothing", "/../node.py", "/server.py"):
            assert (await client.fetch(f"http://127.0.0.1:{port}{path}", raise_error=False)).code == 404
        foreign = HTTPRequest(f"http://127.0.0.1:{port}/", headers={"Host": "evil.example"})
        assert (await client.fetch(foreign, raise_error=False)).code == 403
        page = HTTPRequest(f"ws://127.0.0.1:{port}/stream", headers={"Origin": "http://evil.example"})
        with pytest.raises(Exception, match="403"):
            await websocket_connect(page)

    served(story)


@pytest.mark.parametrize(
    "given, answer",
    [
        pytest.param({"method": "POST", "body": "a" * 4096}, "400", id="a form"),
        pytest.param({"headers": {"Cookie": "a" * 20_000}}, "closed", id="long headers"),
    ],
)
def test_what_no_page_sends_is_refused_before_it_is_parsed(given, answer):
    async def story(_server, port, _sent):
        client = AsyncHTTPClient()
        with pytest.raises(HTTPClientError, match=answer):
            await client.fetch(HTTPRequest(f"http://127.0.0.1:{port}/", **given))
        assert (await client.fetch(f"http://127.0.0.1:{port}/")).code == 200

    served(story)


def test_a_token_is_made_for_its_owner_alone_and_stays(tmp_path):
    file = tmp_path / "new" / "web_token"
    token = token_of(file)
    assert len(token) >= 16
    assert file.stat().st_mode & 0o777 == 0o600
    assert token_of(file) == token
    file.write_text("our own token of today\n")
    assert token_of(file) == "our own token of today"
    for short in ("", "short\n"):
        file.write_text(short)
        with pytest.raises(ValueError, match="at least 8 characters"):
            token_of(file)


def test_two_viewers_see_the_same_and_a_command_is_answered_to_its_sender():
    async def story(server, port, sent):
        one, other = await viewer(port, token=TOKEN), await viewer(port)
        server.take(READY)
        server.take(MessagesCame("r-1", (Note("10:00:00", 0, "Ready.", "", 1),)))
        seen = await hear(one, lambda news: news.get("notes"))
        assert (await hear(other, lambda news: news.get("notes")))["notes"] == seen["notes"]
        order = {"id": "o-1", "token": TOKEN, "board": seen["board"], "seen": "READY", "beat": seen["beat"]}
        for _ in range(3):  # a bad link: sent three times
            await one.write_message(json.dumps({"order": {**order, "command": "go"}}))
        await wait_for(lambda: sent)
        server.take(AnswerCame(sent[0].id, Verdict.DONE, "Starting."))
        answer = await hear(one, lambda news: news.get("answers"))
        assert answer["answers"] == [{"id": "o-1", "request": "go", "verdict": "DONE", "message": "Starting."}]
        one.close()
        again = await viewer(port)  # the connection was lost, and the answer with it
        await again.write_message(json.dumps({"order": {**order, "command": "go"}}))
        assert (await hear(again, lambda news: news.get("answers")))["answers"] == answer["answers"]
        assert [each.words for each in sent] == ["go"]

    served(story)


@pytest.mark.parametrize("heard", [True, False], ids=["silent since Ready", "never heard"])
def test_of_an_engine_that_is_not_heard_a_landing_is_asked_and_a_takeoff_is_not(heard):
    async def story(server, port, sent):
        begun_s = server.now()
        if heard:
            server.take(READY)
        server.now = lambda: begun_s + 7.0
        socket = await viewer(port, token=TOKEN)
        seen = await hear(socket, lambda news: news.get("parts"))
        order = {"token": TOKEN, "board": seen["board"], "seen": "READY" if heard else "", "beat": seen["beat"]}
        for number, command in enumerate(("go", "land")):
            await socket.write_message(json.dumps({"order": {**order, "id": f"o-{number}", "command": command}}))
        [answer] = (await hear(socket, lambda news: news.get("answers")))["answers"]
        assert (answer["verdict"], answer["message"]) == ("NO ANSWER", "Not sent: no contact with the engine.")
        await wait_for(lambda: sent)
        assert [each.words for each in sent] == ["land"]

    served(story)


def test_without_the_token_one_only_looks():
    async def story(server, port, sent):
        server.take(READY)
        socket = await viewer(port, token="guessed")
        assert (await hear(socket, lambda news: "token" in news)) == {"token": False}
        seen = await hear(socket, lambda news: news.get("parts"))
        order = {"id": "o-1", "token": "guessed", "board": seen["board"], "command": "land"}
        await socket.write_message(json.dumps({"order": order}))
        [answer] = (await hear(socket, lambda news: news.get("answers")))["answers"]
        assert (answer["verdict"], sent) == ("REFUSED", [])

    served(story)


@pytest.mark.parametrize("nonsense", ["", "[]", "{", "7", b"\x00\xff", '"have"'])
def test_nonsense_closes_the_connection_that_it_came_over_and_no_other(nonsense):
    async def story(server, port, _sent):
        server.take(READY)
        good, bad = await viewer(port), await viewer(port)
        await bad.write_message(nonsense, binary=isinstance(nonsense, bytes))
        while await bad.read_message() is not None:
            pass
        assert (await hear(good, lambda news: news.get("parts")))["parts"]["state"]["name"] == "READY"

    served(story)


def test_a_viewer_that_does_not_read_costs_nothing_but_its_own_view():
    async def story(server, port, _sent):
        lazy, good = await viewer(port), await viewer(port)
        for number in range(3000):
            server.take(StateCame(Snapshot(state="MISSION", message=f"{number} " + "x" * 400)))
            if number % 100 == 0:
                await asyncio.sleep(0)
        assert (await hear(good, lambda news: "2999" in str(news)))["parts"]["state"]["message"].startswith("2999")
        for each in server.viewers:
            assert len(each.ws_connection.stream._write_buffer) < 1_000_000
        lazy.close()

    served(story)


@pytest.mark.parametrize("port", ["65536", "99999", "-1", "http", "80.5"])
def test_a_port_that_there_is_not_is_refused_by_its_name(port, monkeypatch, capsys, tmp_path):
    pytest.importorskip("rospy", reason="needs ROS")
    from amaze_autonomy.nodes.web import node  # noqa: PLC0415

    monkeypatch.setattr(node, "RosLink", Mock(side_effect=AssertionError("it was started")))
    monkeypatch.setattr(sys, "argv", ["web", "--port", port, "--token-file", str(tmp_path / "token")])
    assert node.main() == 2
    assert capsys.readouterr().err == f"web: --port is {port!r}, must be a number, 0 to 65535\n"


def test_a_port_that_somebody_has_and_an_address_of_nobody_here_are_named():
    pytest.importorskip("rospy", reason="needs ROS")
    from amaze_autonomy.nodes.web.node import listen  # noqa: PLC0415
    from amaze_autonomy.ros.errors import StartError  # noqa: PLC0415

    async def story():
        with socket.create_server(("127.0.0.1", 0)) as other:
            port = other.getsockname()[1]
            with pytest.raises(StartError, match=f"^--port {port}: Address already in use$"):
                listen(PageServer(TOKEN), "127.0.0.1", port)
        with pytest.raises(StartError, match=r"^--address 192\.0\.2\.1: Cannot assign requested address$"):
            listen(PageServer(TOKEN), "192.0.2.1", 0)
        for address in ("no such name", "a" * 64 + ".b", ".."):
            with pytest.raises(StartError, match=f"^--address {re.escape(address)}: "):
                listen(PageServer(TOKEN), address, 0)

    asyncio.run(story())
