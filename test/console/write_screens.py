"""Write the screens that the tests compare with, and the pictures of the documentation, from the scenes.

Run it after a change that is meant to be seen, and look at what has changed: python3 test/console/write_screens.py
With --all FOLDER it writes nothing but every scene there, at 80x24 and 120x40, on a dark and on a light terminal
(`./run screens` does so, and has the operator's page photographed).
The moving picture of a simulated flight is made where ROS and this package's messages are (build/devel/setup.bash).
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path
from typing import Iterator, List

from console_scenes import NOW_S, SCENES
from rich.console import Console

from amaze_autonomy.config import load_configuration
from amaze_autonomy.console.model import Desk, Note
from amaze_autonomy.console.screen.screen import BACK, FORE, moving_svg, svg
from amaze_autonomy.console.screen.style import ASCII, UNICODE, Style
from amaze_autonomy.console.screen.view import Screen
from amaze_autonomy.console.wire import snapshot_of
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.state import EngineState
from amaze_autonomy.journal import journal as codec
from amaze_autonomy.journal.report import MessageLog, report
from amaze_autonomy.paths import config_folder
from amaze_autonomy.simulation import load_scenario
from amaze_autonomy.simulation.run import run

HERE = Path(__file__).parent
S = 1_000_000_000
FRAME_NS, FRAME_S, FRAME_HEIGHT = 2 * S, 0.5, 24  # four times as fast as it was flown
SIZES = ((80, 24), (120, 40))
PICTURES = {
    "mission-input": 22,
    "outreach": 28,
    "ready": 24,
    "mission": 24,
    "hold": 26,
    "land": 24,
    "alarm": 24,
    "mission-ended": 22,
    "stale": 28,
}


def screen(name: str, width: int, style: Style) -> str:
    """Return a scene as plain text, without blanks at the ends of lines."""
    out = io.StringIO()
    console = Console(file=out, width=width, color_system=None, force_terminal=False, legacy_windows=False)
    console.print(Screen(SCENES[name], NOW_S, style), end="")
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def moving_picture() -> str:
    """Return the moving picture of a simulated flight.

    Raises:
        ImportError: ROS, or the messages of this package, are not here.
    """
    return moving_svg(list(_flight()), 100, "A flight: a camera dies, is waited for, comes back", FRAME_S)


def _flight() -> Iterator[Screen]:
    """Return the screens of a flight: a camera dies, is waited for, comes back, and the mission is flown."""
    from amaze_autonomy.nodes.autonomy.outbox import state_message  # noqa: PLC0415  (ROS)

    configuration = load_configuration(config_folder())
    scenario = load_scenario(config_folder() / "faults" / "realsense_camera_returns.yaml")
    flown = run(configuration, (configuration.plan("1").mission,), scenario, seed=1)
    state, messages, due_ns = EngineState(), MessageLog(), 0
    journal = codec.read("\n".join(flown.lines) + "\n")
    for event in (line.payload for line in journal.lines if line.kind == "event"):
        while due_ns < event.t_ns and state.session.mission is not None:
            message = state_message(report(state, configuration.rules), due_ns, due_ns)
            yield Screen(_desk(message, messages, due_ns), due_ns / S, UNICODE, FRAME_HEIGHT)
            due_ns += FRAME_NS
        due_ns = max(due_ns, event.t_ns - FRAME_NS)
        state, commands = decide(state, event, configuration.rules)
        messages.take(event.t_ns, commands)


def _desk(message: object, messages: MessageLog, now_ns: int) -> Desk:
    notes: List[Note] = []
    for each in messages.after(0):
        seconds = each.t_ns // S
        notes.append(Note(f"{seconds // 60:02}:{seconds % 60:02}", each.level - 1, each.text, each.advice, each.number))
    return Desk(snapshot=snapshot_of(message), received_s=now_ns / S, notes=tuple(notes))


def every_picture(folder: Path) -> None:
    """Write a picture of every scene in the sizes of a terminal, dark and light."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, desk in SCENES.items():
        for width, height in SIZES:
            dark = svg(Screen(desk, NOW_S, UNICODE, height), width, f"The console: {name}, {width}x{height}")
            light = dark.replace(f'fill="{FORE}"', f'fill="{BACK}"').replace(
                f'rx="8" fill="{BACK}"', 'rx="8" fill="#ffffff"'
            )
            for shade, picture in (("dark", dark), ("light", light)):
                (folder / f"console-{name}-{width}x{height}-{shade}.svg").write_text(picture, encoding="utf-8")


def main() -> None:
    """Write all files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", type=Path, metavar="FOLDER", help="every scene in all sizes, into this folder")
    options = parser.parse_args()
    if options.all is not None:
        every_picture(options.all)
        return
    (HERE / "screens").mkdir(exist_ok=True)
    for name in SCENES:
        for width, style in ((100, UNICODE), (60, ASCII)):
            (HERE / "screens" / f"{name}-{width}.txt").write_text(screen(name, width, style), encoding="utf-8")
    images = HERE.parent.parent / "docs" / "images"
    images.mkdir(exist_ok=True)
    for name, height in PICTURES.items():
        picture = svg(Screen(SCENES[name], NOW_S, UNICODE, height), 100, f"The console: {name}")
        (images / f"console-{name}.svg").write_text(picture, encoding="utf-8")
    try:
        picture = moving_picture()
    except ImportError as error:
        print(f"the moving picture is left as it was: {error}")
        return
    (images / "flight.svg").write_text(picture, encoding="utf-8")


if __name__ == "__main__":
    main()
