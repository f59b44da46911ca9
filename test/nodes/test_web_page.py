"""The operator's page in a real Chromium: a mission clicked through over a bad link, two viewers, all restarted."""

from __future__ import annotations

import asyncio
import os
import shutil
import sys
import threading
import time
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Callable, List

import pytest

pytest.importorskip("tornado")
pytest.importorskip("rospy", reason="the stand-in for the engine speaks its real messages")
pytest.importorskip("selenium")

from selenium import webdriver
from tornado.ioloop import IOLoop

sys.path.append(str(Path(__file__).parents[1] / "console"))

from console_scenes import ON_THE_PAGE, SCENES

from amaze_autonomy.config import load_configuration
from amaze_autonomy.config.model import Configuration
from amaze_autonomy.console.link import AnswerCame, CollectingCame, MessagesCame, MissionsCame, StateCame
from amaze_autonomy.console.model import Collecting, MissionRow, Note, Platform, Request, RequestKind, Snapshot
from amaze_autonomy.console.wire import snapshot_of, verdict_of
from amaze_autonomy.engine.commands import Answer
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import EngineStarted, MissionSelected, Tick, UserRequest
from amaze_autonomy.engine.state import EngineState
from amaze_autonomy.engine.timers import next_deadline
from amaze_autonomy.journal.report import MessageLog, report
from amaze_autonomy.nodes.autonomy.outbox import state_message
from amaze_autonomy.nodes.web import server
from amaze_autonomy.nodes.web.board import Board
from amaze_autonomy.nodes.web.server import PageServer
from amaze_autonomy.paths import config_folder
from amaze_autonomy.simulation import World

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(not CHROMIUM or not DRIVER, reason="no Chromium here: apt-get install chromium chromium-driver"),
]
LIMIT_S = 120.0
TOKEN = "a token of the vehicle"
ALARM = 3  # a message of this level stands above all
SURVEY = 4  # of the shipped missions, and the longest
#: AMAZE_PICTURES=FOLDER writes a picture of each scene, light and dark (`./run screens`), and the two of docs/images.
PICTURES = os.environ.get("AMAZE_PICTURES", "")

# --- the engine and the simulated world behind the page, without ROS' wires, and a bad radio link in front of it ---

S = 1_000_000_000
TURN_S = 0.1


class Stack:
    """One start of everything but the page's server.

    Args:
        configuration: of engine and world.
        server: of the page.
        run: names the start.
        speed: simulated seconds per second.
    """

    def __init__(self, configuration: Configuration, server: PageServer, run: str, speed: float) -> None:
        self.configuration, self.server, self.run, self.speed = configuration, server, run, speed
        self.world, self.state, self.messages = World(configuration), EngineState(), MessageLog()
        self.received: List[str] = []
        self.stopped = False
        server.send = self.send
        self.take(EngineStarted(t_ns=0, label=run))

    async def fly(self) -> None:
        """Go on in simulated time until it is stopped."""
        while not self.stopped:
            until_ns = self.world.now_ns + int(self.speed * TURN_S * S)
            while self.world.now_ns < until_ns:
                deadline_ns = next_deadline(self.state, self.configuration.rules)
                t_ns = min(self.world.next_ns, until_ns, *([] if deadline_ns is None else [deadline_ns]))
                for event in self.world.advance(max(t_ns, self.world.now_ns)):
                    self.take(event)
                if deadline_ns is not None and deadline_ns <= self.world.now_ns:
                    self.take(Tick(t_ns=self.world.now_ns))
            self.publish()
            await asyncio.sleep(TURN_S)

    def take(self, event) -> None:
        before = self.state
        self.state, commands = decide(self.state, event, self.configuration.rules)
        self.messages.take(event.t_ns, commands)
        for command in commands:
            if isinstance(command, Answer):
                self.server.take(AnswerCame(command.request_id, verdict_of(command.answer.value), command.message))
            self.world.handle(max(event.t_ns, self.world.now_ns), command)
        if self.state.state is not before.state:
            self.world.observe_state(self.world.now_ns, self.state.state.value)

    def publish(self) -> None:
        message = state_message(report(self.state, self.configuration.rules), self.state.t_ns, self.state.t_ns)
        notes = (
            Note("10:00:00", each.level - 1, each.text, each.advice, each.number) for each in self.messages.after(0)
        )
        self.server.take(MessagesCame(self.run, tuple(notes)))
        recorder = self.state.peers.recorder
        if recorder is not None:
            platforms = tuple(
                Platform(each.platform, each.growing, each.written_bytes, each.byte_rate, each.free_fraction)
                for each in recorder.platforms
            )
            self.server.take(CollectingCame(Collecting(recorder.session_id, recorder.phase.name, platforms=platforms)))
        self.server.take(StateCame(snapshot_of(message)))

    def send(self, request: Request) -> None:
        if request.kind is RequestKind.LIST:
            rows = [
                MissionRow(each.id, each.description, each.files, each.repetitions, each.estimated_duration_s, 0.3)
                for each in self.configuration.missions
            ]
            self.server.take(MissionsCame(request.id, tuple(rows)))
            return
        self.received.append(request.words)
        t_ns = self.world.now_ns
        if request.command is not None:
            self.take(UserRequest(t_ns=t_ns, command=request.command, request_id=request.id))
        else:
            missions = tuple(self.configuration.plan(each).mission for each in request.missions)
            self.take(MissionSelected(t_ns=t_ns, missions=missions, request_id=request.id))
        self.publish()


class BadLink:
    """A proxy in front of a port: 200 ms each way; connections are cut while commands are under way.

    Args:
        port: that it leads to.
        cuts: returns True when the connection that has just carried something upwards is to be cut.
    """

    DELAY_S = 0.2

    def __init__(self, port: int, cuts: Callable[[bytes], bool]) -> None:
        self.port, self.cuts, self.lost = port, cuts, 0

    async def listen(self) -> int:
        server = await asyncio.start_server(self._connect, "127.0.0.1", 0)
        return server.sockets[0].getsockname()[1]

    async def _connect(self, reader, writer) -> None:
        try:
            up_reader, up_writer = await asyncio.open_connection("127.0.0.1", self.port)
        except OSError:
            writer.close()
            return
        pipes = [self._pipe(reader, up_writer, upwards=True), self._pipe(up_reader, writer, upwards=False)]
        await asyncio.wait([asyncio.ensure_future(each) for each in pipes], return_when=asyncio.FIRST_COMPLETED)
        for each in (writer, up_writer):
            each.close()

    async def _pipe(self, reader, writer, *, upwards: bool) -> None:
        loop = asyncio.get_running_loop()
        try:
            while True:
                data = await reader.read(1 << 16)
                if not data:
                    return
                loop.call_later(self.DELAY_S, writer.write, data)
                if upwards and self.cuts(data):
                    self.lost += 1
                    await asyncio.sleep(self.DELAY_S * 1.1)  # it arrives; its answer does not
                    return
        except OSError:
            return


# --- the field: all of that on a loop of its own, and browsers ---


class Field:
    """Server, stack and links on a loop of their own."""

    def __init__(self) -> None:
        self.configuration = load_configuration(
            config_folder(),
            [
                "autonomy.require_go=true",
                "autonomy.checks.ready_limit_s=3600",  # a starved machine clicks late
                "autonomy.flight.max_flight_time_s=7200",
                "autonomy.commands.user_hold_limit_s=3600",
            ],
        )
        self.loop, self.sent, self.cut_next = None, 0, 0
        ready = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(ready,), daemon=True)
        self._thread.start()
        assert ready.wait(LIMIT_S)
        self.start("r-1", 0)
        self.bad_port = self.call(self._listen_badly)

    def _run(self, ready) -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        self.loop = IOLoop.current()
        self.loop.add_callback(ready.set)
        self.loop.start()

    def call(self, make):
        """Run something on the loop and return what comes of it."""

        async def wrapped():
            return await make()

        return asyncio.run_coroutine_threadsafe(wrapped(), self.loop.asyncio_loop).result(LIMIT_S)

    def start(self, run, port, speed=4.0):
        async def begin():
            self.server = PageServer(TOKEN, self.configuration.plans)
            self.port = self.server.listen(port)[1]
            self.stack = Stack(self.configuration, self.server, run, speed)
            self.flight = asyncio.ensure_future(self.stack.fly())

        self.call(begin)

    def stop(self):
        async def end():
            self.stack.stopped = True
            await self.flight
            self.server.close()

        self.call(end)

    def freeze(self):
        """Have the stack say nothing more."""

        async def end():
            self.stack.stopped = True
            self.stack.publish = lambda: None

        self.call(end)

    async def forget(self, board_id="") -> None:
        """Be a server that has never heard of an engine, which is there all the same, and answers."""
        self.server.board = Board(board_id or self.server.board.id)

    async def relist(self) -> None:
        """Be another start of the engine."""
        self.stack.run = "r-9"

    def show(self, desk):
        """Have the page show a scene of the console."""

        async def post():
            self.server.take(MessagesCame("scenes", desk.notes))
            self.server.take(StateCame(desk.snapshot))
            self.server.take(CollectingCame(desk.collecting or Collecting()))

        self.call(post)

    async def _listen_badly(self):
        self.bad = BadLink(self.port, self._cuts)
        return await self.bad.listen()

    def _cuts(self, data) -> bool:
        """Cut after the next command, once, when asked to; frames of the browser are masked, but longer than a beat."""
        if self.cut_next and len(data) > 150:
            self.cut_next -= 1
            return True
        return False

    def close(self):
        self.stop()
        self.loop.add_callback(self.loop.stop)
        self._thread.join(LIMIT_S)


class Page:
    """One browser with the page open, as a tablet in portrait."""

    def __init__(self, port, *, dark=False, token=TOKEN) -> None:
        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM
        for each in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=820,1180"):
            options.add_argument(each)
        if dark:
            options.add_argument("--blink-settings=preferredColorScheme=0")
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
        self.driver.get(f"http://127.0.0.1:{port}/" + (f"#{token.replace(' ', '%20')}" if token else ""))

    def text(self, part) -> str:
        return self.driver.execute_script("return document.getElementById(arguments[0]).innerText", part)

    def wait(self, part, *words) -> str:
        """Wait until a part of the page says one of the words."""
        return self.until(lambda: next((word for word in words if word in self.text(part)), None), f"{words} in {part}")

    def until(self, found, what, pause_s=0.05):
        deadline_s = time.monotonic() + LIMIT_S
        while time.monotonic() < deadline_s:
            result = found()
            if result:
                return result
            time.sleep(pause_s)
        raise AssertionError(f"no {what}:\n{self.driver.execute_script('return document.body.innerText')}")

    def ask(self, selector, part, word, *, question=True):
        """Press a button, confirm its question, and wait; once more when the page says that it came too late."""

        def there():
            if word in self.text(part):
                return True
            self.press(selector)
            if question:
                self.press("#yes")
            return False

        self.until(there, f"{word} in {part} after {selector}", pause_s=3.0)

    def press(self, selector):
        """Press a button that is there and can be pressed, as long as no command is under way."""
        script = """const b = document.querySelector(arguments[0]);
            if (b && !b.disabled && b.offsetParent && !orders.size) b.click();"""
        self.driver.execute_script(script, selector)

    def count(self, selector) -> int:
        return self.driver.execute_script("return document.querySelectorAll(arguments[0]).length", selector)

    def picture(self, name):
        if PICTURES:
            time.sleep(1.0)
            self.driver.save_screenshot(str(Path(PICTURES) / f"page-{name}.png"))

    def errors(self):
        """Return what the browser complains of, the cut connections left out."""
        return [each for each in self.driver.get_log("browser") if "WebSocket" not in each["message"]]


@contextmanager
def opened(*arguments, **options):
    page = Page(*arguments, **options)
    try:
        yield page
    finally:
        page.driver.quit()


@pytest.fixture
def field():
    made = Field()
    yield made
    made.close()


@pytest.mark.night
def test_a_mission_is_clicked_through_over_a_bad_link_by_one_of_two_viewers_and_everything_is_restarted(field):
    with opened(field.bad_port) as pilot, opened(field.port, token="", dark=True) as guest:
        pilot.wait("missions", "Short square")
        field.cut_next = 1
        pilot.ask(f".mission:nth-child({SURVEY})", "state", "READY")
        guest.wait("state", "READY")
        field.cut_next = 1
        pilot.ask(".go", "where", "flying")
        field.stack.speed = 1.0
        field.cut_next = 1
        pilot.ask(".hold", "where", "holding", question=False)
        pilot.until(lambda: not pilot.text("faults").strip(), "page without a fault")  # the operator's own hold is none
        guest.wait("state", "HOLD")
        guest.picture("hold-dark")
        pilot.ask(".resume", "state", "MISSION")
        pilot.picture("mission")
        pilot.ask(".land", "state", "LAND")
        field.stack.speed = 8.0
        pilot.wait("state", "MISSION ENDED")
        assert field.stack.received == [f"mission {SURVEY}", "go", "hold", "resume", "land"]
        assert field.bad.lost == 3

        assert guest.text("messages").replace("Select the next", "") == pilot.text("messages").replace(
            "Select the next", ""
        )
        shown = [row.split("\n") for row in pilot.text("messages").splitlines()]
        assert any("Landing as you asked." in line for row in shown for line in row)
        assert guest.count("#commands button:not(:disabled), .mission:not(:disabled)") == 0
        assert "2 viewers" in guest.text("viewers")

        field.stop()
        pilot.wait("lost", "NO CONTACT")
        field.start("r-2", field.port)
        for page in (pilot, guest):
            page.wait("state", "MISSION INPUT")
            page.until(lambda page=page: not page.text("lost").strip(), "contact")
            assert page.text("messages").strip() == ""
        pilot.ask(".mission", "state", "READY")
        assert field.stack.received == ["mission 1"]
        assert pilot.errors() == guest.errors() == []


def test_several_missions_are_selected_one_after_the_other(field):
    with opened(field.port) as page:
        page.wait("missions", "Short square")
        for number in (2, 2, 1, 2):  # the same one twice is a finger that trembles
            page.press(f".mission:nth-child({number})")
        assert page.text("asked") == "Fly missions 2, 1, one after the other?"
        page.press("#no")
        assert field.stack.received == []

        def selected():
            if not field.stack.received:
                for selector in (".mission:nth-child(2)", ".mission:nth-child(1)", "#yes"):
                    page.press(selector)
            return field.stack.received

        assert page.until(selected, "selection", pause_s=3.0) == ["mission 2, 1"]
        page.wait("where", "then mission 1")


def test_an_engine_that_is_silent_is_asked_to_land_whatever_it_said_last_and_to_do_nothing_else(field):
    """The vehicle may have taken off since: a page that answered in the engine's place would say that it stands."""
    field.freeze()
    with opened(field.port) as page:
        script = page.driver.execute_script
        buttons = "return [...document.querySelectorAll('#commands button')].map((each) => each.className)"

        def asked_to_go():
            field.show(SCENES["ready"])
            page.press(".go")
            return page.text("asked").startswith("Go:")

        page.until(asked_to_go, "question of a takeoff")
        page.wait("answer", "go: NOT SENT no contact.")
        assert script(buttons) == ["hold", "land", "abort"]
        page.press(".land")
        assert page.text("asked") == "LAND at the present position?"
        page.press("#yes")
        page.wait("answer", "LAND: REFUSED The vehicle is not in flight.")  # by the engine: the stand-in's never flew
        assert field.stack.received == ["land"]


def test_an_engine_that_was_never_heard_is_asked_to_land(field):
    field.freeze()
    with opened(field.port) as page:
        field.call(field.forget)
        page.driver.refresh()
        page.wait("where", "Waiting for the engine")
        page.until(lambda: page.press(".land") or page.text("asked"), "question of a landing")
        page.press("#yes")
        page.wait("answer", "LAND: REFUSED The vehicle is not in flight.")
        assert field.stack.received == ["land"]


def test_of_an_engine_that_a_new_server_has_not_heard_nothing_is_shown_and_land_is_sent(field):
    field.freeze()
    with opened(field.port) as page:
        page.until(lambda: field.show(SCENES["alarm"]) or page.text("alarm"), "alarm")
        field.call(partial(field.forget, "b-2"))
        page.wait("state", "WAITING")
        page.wait("link", "no engine heard")
        shown = [page.text(part).strip() for part in ("alarm", "left", "message", "advice", "readings", "faults")]
        assert shown == [""] * len(shown)
        page.until(lambda: page.press(".land") or page.text("asked"), "question of a landing")
        page.press("#yes")
        page.wait("answer", "LAND: REFUSED The vehicle is not in flight.")
        assert page.errors() == []


def test_what_was_long_under_way_is_as_old_as_it_is(field):
    with opened(field.port) as page:
        page.wait("missions", "Short square")
        assert page.text("lost").strip() == ""
        page.driver.execute_script("wayS -= 30;")  # as if the first message had been 30 s less under way than all since
        page.wait("lost", "NO CONTACT with the vehicle's computer for 3")
        assert page.driver.execute_script("return offered().map((each) => each.name)") == ["hold", "land", "abort"]


SLOW_TO_DRAW = """drawn = 0;
draw = () => { drawn += 1; for (const end = nowMs() + 600; nowMs() < end;); };"""


@pytest.mark.night
def test_a_browser_that_is_slow_to_draw_shows_what_is_new_all_the_same(field):
    with opened(field.port) as page:
        page.wait("missions", "Short square")
        page.driver.execute_script(f"window.drawn = 0; {SLOW_TO_DRAW}")
        first = page.driver.execute_script("return have.sample")
        page.until(lambda: page.driver.execute_script("return have.sample") > first + 60, "sixty samples")
        assert page.driver.execute_script("return [drawn > 3, lost()]") == [True, ""]


def test_a_list_that_comes_anew_takes_the_question_of_the_one_before_away(field):
    with opened(field.port, token="100%") as page:
        page.wait("missions", "Short square")
        page.driver.execute_script(f"useToken({TOKEN!r})")
        page.until(lambda: page.press(".mission") or page.text("asked"), "question of a mission")
        field.call(field.relist)
        page.wait("answer", "mission 1: NOT SENT the missions are listed anew: choose again.")
        assert page.text("asked") == ""
        assert field.stack.received == []


def test_names_of_others_are_never_markup_and_without_plotly_all_but_the_plots_is_there(field, monkeypatch):
    monkeypatch.setattr(server, "plotly_file", lambda: None)
    evil = '<img src=x onerror="window.broken=1"><b>bold</b>'
    field.stop()
    field.start("r-1", field.port, speed=0.0)

    async def say():
        field.stack.stopped = True
        await asyncio.sleep(0.3)
        snapshot = Snapshot(state=evil, message=evil, advice=evil, mission_id=evil, mission_description=evil)
        field.server.take(StateCame(snapshot))
        field.server.take(MessagesCame("r", (Note("10:00", 1, evil, evil, 1),)))
        field.server.board._put("missions", [dict.fromkeys(("id", "words", "duration", "battery", "error"), evil)])

    with opened(field.port) as page:
        field.call(say)
        page.wait("messages", evil)
        assert page.text("message") == evil
        assert page.count("#message b, #messages b, img") == 0
        assert page.driver.execute_script("return window.broken") is None
        hidden = 'return ["no-plots", "track-part", "plots-part"].map((id) => $(id).hidden)'
        assert page.driver.execute_script(hidden) == [False, True, True]


@pytest.mark.night
def test_every_scene_of_the_console_is_shown_by_a_light_and_a_dark_page_without_an_error(field):
    field.freeze()
    with opened(field.port) as light, opened(field.port, dark=True) as dark:
        for name, desk in ON_THE_PAGE.items():
            field.show(desk)
            for page, shade in ((light, "light"), (dark, "dark")):
                page.wait("state", desk.snapshot.state.replace("_", " "))
                page.wait("alarm" if desk.snapshot.message_level == ALARM else "message", desk.snapshot.message)
                page.until(partial(bar_is_as_it_is_to_be, field, page, desk), "bar as it is to be")
                page.until(lambda page=page: page.driver.execute_script(TRACK_IS_WIDE), "track of some metres")
                flying = desk.snapshot.in_flight and desk.snapshot.waypoints
                marked = [f"waypoint {desk.snapshot.waypoint} of {desk.snapshot.waypoints}"] if flying else []
                assert page.driver.execute_script(WAYPOINTS_IN_TRACK) == marked
                page.picture(f"{name}-820x1180-{shade}")
        assert light.errors() == dark.errors() == []


def bar_is_as_it_is_to_be(field, page, desk):
    field.show(desk)  # again: on a starved machine the engine may count as silent by now
    return page.driver.execute_script('return $("bar").hidden') == (not desk.snapshot.user_commands)


WAYPOINTS_IN_TRACK = """
return $("track").data.map((each) => each.name).filter((name) => name.startsWith("waypoint"));"""
TRACK_IS_WIDE = """const plot = $("track")._fullLayout;
return plot && ["xaxis", "yaxis"].every((each) => plot[each].range[1] - plot[each].range[0] >= 4)"""
SPEAKER = """
window.tones = [];
window.AudioContext = class {
  currentTime = 0;
  createOscillator() {
    const frequency = {}, connect = (next) => next, start = () => tones.push(frequency.value), stop = () => {};
    return { frequency, connect, start, stop };
  }
  createGain() {
    const gain = { setValueAtTime: () => {}, exponentialRampToValueAtTime: () => {} };
    return { gain, connect: (next) => next };
  }
  close() {}
};"""
FLASHING = """return ["alarm", "lost"].filter(
  (id) => !$(id).hidden && getComputedStyle($(id)).animationName === "flash")"""
TONES = "return tones.splice(0)"
ALARM_HZ = 1000


def test_an_alarm_in_land_and_an_engine_that_is_silent_in_flight_flash_and_sound_until_they_are_over(field):
    field.freeze()
    landing, alarm = SCENES["land"], SCENES["alarm"]
    assert (landing.snapshot.state, alarm.snapshot.state, alarm.snapshot.message_level) == ("LAND", "LAND", ALARM)
    with opened(field.port) as page:
        script = page.driver.execute_script

        def calm():
            field.show(landing)
            return page.text("message").endswith(landing.snapshot.message) and script(FLASHING) == []

        page.until(calm, "landing without an alarm")
        script(SPEAKER)
        page.press("#sound")
        assert page.text("sound") == "sound is on"
        field.show(alarm)
        page.wait("alarm", alarm.snapshot.message)
        assert "alarm" in script(FLASHING)
        page.until(lambda: ALARM_HZ in script(TONES), "tone of the alarm")
        page.until(calm, "end of the alarm")
        script(TONES)
        page.wait("lost", "THE ENGINE is silent")
        assert script(FLASHING) == ["lost"]
        page.until(lambda: ALARM_HZ in script(TONES), "tone of the silence")


NO_TIMERS = "for (const name of ['setInterval', 'setTimeout']) window[name] = () => 0;"
NO_WORKERS = "delete window.Worker;"


@pytest.mark.parametrize("lacks", [NO_TIMERS, NO_WORKERS], ids=["a tab that is not in front", "a browser that is old"])
def test_a_silence_in_flight_is_an_alarm_also_where_the_page_has_no_timers_or_no_worker(field, lacks):
    """Browsers let the timers of a tab that is not in front run once a minute, or not at all; a worker's go on."""
    field.freeze()
    with opened(field.port) as page:
        page.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": lacks})
        page.driver.refresh()
        page.until(lambda: field.show(SCENES["mission"]) or page.text("state") == "MISSION", "flight")
        page.wait("lost", "THE ENGINE is silent")
        assert "lost" in page.driver.execute_script(FLASHING)
        assert page.errors() == []


@pytest.mark.night
def test_many_messages_do_not_make_the_page_grow(field):
    def say(first):
        async def post():
            notes = tuple(Note("10:00", 0, f"message {n}", "", n) for n in range(first, first + 200))
            field.server.take(MessagesCame("r-9", notes))
            field.server.take(StateCame(Snapshot(state="MISSION", message=f"message {first}")))

        return post

    field.freeze()
    with opened(field.port) as page:
        sizes = []
        for first in range(1, 10_000, 200):
            field.call(say(first))
            page.wait("messages", f"message {first + 199}")
            sizes.append((page.count("#messages li"), page.count("*")))
        assert sizes[-1][0] == 400
        assert set(sizes[2:]) == {sizes[-1]}
