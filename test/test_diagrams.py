"""The pictures that are drawn from tables: all that is in the tables is in them, and they can be read."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from amaze_autonomy.documents import BACK, PICTURES, architecture, drawn, state_diagram, ways
from amaze_autonomy.engine.state import State
from amaze_autonomy.engine.transitions import TRANSITIONS, places_of
from amaze_autonomy.interface import PEERS, SERVICES, STATUSES
from amaze_autonomy.pages.contents import STATE_COLOURS

ROOT = Path(__file__).parents[1]
NAMES = {"s": "http://www.w3.org/2000/svg"}
LETTER = 6.02  # px of a letter in the fonts of the pictures


def of(picture, kind):
    return ET.fromstring(picture).findall(f"s:{kind}", NAMES)


def words(picture):
    return [each.text for each in of(picture, "text")]


def luminance(colour):
    parts = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_the_pictures_of_the_documentation_are_as_the_tables_are():
    assert [path for path, is_there, should_be in drawn(ROOT / "docs") if is_there != should_be] == [], (
        "run: amaze-autonomy docs"
    )


def test_a_picture_that_is_not_there_yet_differs(tmp_path):
    assert {path.name: is_there for path, is_there, _ in drawn(tmp_path)} == {f"{name}.svg": "" for name in PICTURES}


@pytest.mark.parametrize("name", PICTURES)
def test_a_page_shows_the_picture(name):
    pages = [ROOT / "README.md", *ROOT.glob("docs/*.md")]
    assert any(f"images/{name}.svg)" in page.read_text(encoding="utf-8") for page in pages)


def test_no_page_has_a_drawing_that_the_site_would_show_as_text():
    for page in (ROOT / "README.md", *ROOT.glob("docs/*.md")):
        assert "```mermaid" not in page.read_text(encoding="utf-8"), page


@pytest.mark.parametrize("draw", PICTURES.values())
def test_a_picture_has_its_own_background_and_all_that_is_on_it_stands_out_and_is_within(draw):
    root = ET.fromstring(draw())
    width, height = map(float, root.attrib["viewBox"].split()[2:])
    card, *boxes = of(draw(), "rect")
    assert (float(card.attrib["width"]), float(card.attrib["height"]), card.attrib["fill"]) == (width, height, BACK)
    colours = {*re.findall(r'stroke="(#\w+)"', draw()), *(box.attrib["fill"] for box in boxes)}
    for text in of(draw(), "text"):
        long, x, anchor = len(text.text) * LETTER, float(text.attrib["x"]), text.attrib["text-anchor"]
        left = x - {"start": 0, "middle": long / 2, "end": long}[anchor]
        assert left >= 0, text.text
        assert left + long <= width, text.text
        colours |= {text.attrib["fill"]} - {"#000000"}  # black is on the boxes, which are light
    for colour in colours:
        assert (luminance(colour) + 0.05) / (luminance(BACK) + 0.05) > 4.5, colour  # WCAG 2, level AA


def test_every_way_between_states_is_a_line_in_the_colour_of_where_it_leads():
    dots = [each.attrib["fill"] for each in of(state_diagram(), "circle")][:-1]  # the last is where all begins
    assert sorted(dots) == sorted(STATE_COLOURS[target.value] for _, target in ways())
    assert [word for word in words(state_diagram()) if word in State.__members__] == [state.value for state in State]


def test_every_rule_is_named_or_counted_on_its_way():
    shown = [word for word in words(state_diagram()) if word not in State.__members__]
    assert len(shown) == len(ways())
    for label, rules in zip(shown, ways().values()):
        names, _, more = label.partition(" and ")
        named = names.split(", ")
        assert named == list(rules[: len(named)])
        assert len(named) + (int(more.split()[0]) if more else 0) == len(rules)


def test_every_row_that_leads_to_another_state_is_on_a_way_and_no_other():
    between = {rule for rules in ways().values() for rule in rules}
    for row in TRANSITIONS:
        states = {place[0] for source in row.sources for place in places_of(source)}
        assert (row.rule in between) == bool(row.target and states - {row.target[0]}), row.rule
    assert {"land", "select_next"} <= between
    assert "lifted_off" not in between  # within TAKEOFF


def test_lanes_of_one_column_do_not_meet():
    order = list(State)
    lanes = [
        [tuple(map(float, point.split())) for point in path.attrib["d"][1:].split(" L")]
        for path in of(state_diagram(), "path")
        if path.attrib.get("stroke-width") == "2"
    ]
    spans = sorted((points[0][0], min(points[0][1], points[1][1]), max(points[0][1], points[1][1])) for points in lanes)
    assert len(spans) == len({(target, order.index(target) > order.index(source)) for source, target in ways()})
    for (x, _, bottom), (other_x, top, _) in zip(spans, spans[1:]):
        assert x != other_x or bottom < top


@pytest.mark.parametrize("peer", PEERS)
def test_a_peer_is_in_the_architecture_with_its_services_and_statuses(peer):
    shown = words(architecture())
    assert peer.replace("_", " ") in shown
    for names in ([*SERVICES], [status.topic for status in STATUSES]):
        own = [name.split("/", 1)[1] for name in names if name.split("/", 1)[0] == peer]
        assert not own or ", ".join(own) in shown
