"""Texts from the wire cannot steer a terminal."""

from __future__ import annotations

import pytest

from amaze_autonomy.console.wire import clean


@pytest.mark.parametrize(
    "sent, shown",
    [
        ("plain words, 5 m", "plain words, 5 m"),
        ("Höhe 3 m → gut", "Höhe 3 m → gut"),
        ("two\nlines\r\n\tand a tab", "two lines and a tab"),
        ("\x1b[31mred\x1b[0m", "red"),
        ("\x1b[2J\x1b[Hcleared", "cleared"),
        ("\x9b31mC1 introducer", "C1 introducer"),
        ("\x1b]0;title\x07after", "after"),
        ("\x1b]8;;http://x\x1b\\link\x1b]8;;\x1b\\", "link"),
        ("\x1b]52;c;bm90IGNsb3NlZA==", ""),
        ("\x1bP1;2qsixel\x1b\\after", "after"),
        ("\x1bcreset", "reset"),
        ("\x1b(0line drawing", "line drawing"),
        ("bell\x07 back\x08space nul\x00", "bell? back?space nul?"),
        ("trailing\x1b", "trailing"),
        ("nested \x1b\x1b[31m", "nested"),
        ("\x1b[\x1b[31mm", "m"),
        ("right-to-left \u202egnp.exe", "right-to-left ?gnp.exe"),
        ("zero\u200bwidth", "zero?width"),
        ("line\u2028separator", "line separator"),
        ("lone \ud800 surrogate", "lone ? surrogate"),
        ("[bold red]markup stays text[/bold red]", "[bold red]markup stays text[/bold red]"),
    ],
)
def test_what_a_terminal_would_obey_is_gone(sent, shown):
    assert clean(sent) == shown


def test_no_code_point_survives_that_is_a_control():
    text = "".join(map(chr, range(0x3000)))
    assert [letter for letter in clean(text, limit=0x4000) if ord(letter) < 32 or 127 <= ord(letter) < 160] == []


def test_a_long_text_is_cut():
    assert clean("x" * 100, limit=10) == "xxxxxxx..."
    assert len(clean("\x1b[31m" * 1_000_000)) == 0
