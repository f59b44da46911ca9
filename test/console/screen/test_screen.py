"""The picture of a screen."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from console_scenes import NOW_S, SCENES
from rich.text import Text
from write_screens import PICTURES, every_picture, moving_picture

from amaze_autonomy.console.screen.screen import BACK, FORE, moving_svg, svg
from amaze_autonomy.console.screen.style import UNICODE
from amaze_autonomy.console.screen.view import Screen

IMAGES = Path(__file__).parents[3] / "docs" / "images"
NAMES = {"s": "http://www.w3.org/2000/svg"}


def words(picture):
    return [text.text for text in ET.fromstring(picture).iterfind(".//s:text", NAMES)]


def test_letters_are_text_blocks_are_rectangles():
    assert svg(Text("a  b█▄ <&>", style="bold #ffffff on #c00000"), 12, "A & B").splitlines() == [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 132 43" role="img" font-size="15" '
        'font-family="DejaVu Sans Mono, ui-monospace, Menlo, Consolas, monospace" xml:space="preserve">',
        "<title>A &amp; B</title>",
        '<rect width="132" height="43" rx="8" fill="#101418"/>',
        '<rect x="12" y="12" width="90.5" height="19.5" fill="#c00000"/>',
        '<text x="12" y="26.5" fill="#ffffff" font-weight="bold" textLength="9">a</text>',
        '<text x="39" y="26.5" fill="#ffffff" font-weight="bold" textLength="9">b</text>',
        '<rect x="48" y="12" width="9.2" height="19.2" fill="#ffffff"/>',
        '<rect x="57" y="21.5" width="9.2" height="9.7" fill="#ffffff"/>',
        '<text x="75" y="26.5" fill="#ffffff" font-weight="bold" textLength="27">&lt;&amp;&gt;</text>',
        "</svg>",
    ]


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_makes_a_picture_that_is_well_formed(name):
    assert ET.fromstring(svg(Screen(SCENES[name], NOW_S, UNICODE), 100, name)).tag == "{http://www.w3.org/2000/svg}svg"


@pytest.mark.parametrize("name, height", PICTURES.items())
def test_the_pictures_of_the_documentation_show_the_console_as_it_is(name, height):
    shown = (IMAGES / f"console-{name}.svg").read_text(encoding="utf-8")
    assert words(shown) == words(svg(Screen(SCENES[name], NOW_S, UNICODE, height), 100, f"The console: {name}"))


def test_every_scene_is_drawn_as_it_fits_into_small_and_large_terminals_dark_and_light(tmp_path):
    every_picture(tmp_path)
    named = {
        f"console-{name}-{size}-{shade}.svg"
        for name in SCENES
        for size in ("80x24", "120x40")
        for shade in ("dark", "light")
    }
    assert {path.name for path in tmp_path.iterdir()} == named
    dark, light = ((tmp_path / f"console-outreach-80x24-{shade}.svg").read_text("utf-8") for shade in ("dark", "light"))
    assert words(dark) == words(light)
    assert (dark.count(BACK), light.count("#ffffff")) == (1, dark.count("#ffffff") + 1)
    assert FORE not in light


def test_the_moving_picture_of_the_documentation_is_of_the_flight_as_it_would_be_today():
    pytest.importorskip("rospy", reason="the state is published as a message of ROS")
    shown = (IMAGES / "flight.svg").read_text(encoding="utf-8")
    assert words(shown) == words(moving_picture()), "run: python3 test/console/write_screens.py"


def test_a_moving_picture_has_what_stays_once_and_shows_the_rest_in_its_frames():
    frames = [Text(f"stays\n{changes}") for changes in ("one", "two", "two", "one")]

    root = ET.fromstring(moving_svg(frames, 10, "what moves", 0.5))

    rows = {"".join(each.itertext()).strip(): each for each in root.iterfind(".//s:g", NAMES)}
    animated = {text: row.find("s:animate", NAMES).attrib for text, row in rows.items()}
    assert [each.text for each in root.iterfind(".//s:text", NAMES)] == ["stays", "one", "two"]
    assert {text: each["values"] for text, each in animated.items()} == {
        "one": "visible;hidden;visible",
        "two": "hidden;visible;hidden",
    }
    assert {each["keyTimes"] for each in animated.values()} == {"0;0.25;0.75"}
    assert {each["dur"] for each in animated.values()} == {"2s"}
