"""Large letters."""

from __future__ import annotations

from amaze_autonomy.console.screen.view import banner
from amaze_autonomy.engine.state import State

BLOCKS = " .'#"


def test_letters_are_three_lines_of_half_blocks():
    assert banner("LAND 1:05", BLOCKS) == [
        ".     ..  .  . ...      .    ..  ....",
        "#    #..# #'.# #  #    '# ' #  # #.. ",
        "#... #  # #  # #..'     # ' '..' ...'",
    ]


def test_every_state_can_be_written_on_a_hundred_columns_with_its_time():
    for state in State:
        letters, digits = banner(state.value.replace("_", " "), BLOCKS), banner("88:88", BLOCKS)
        assert letters is not None
        assert digits is not None
        assert len({len(line) for line in letters}) == 1
        assert len(letters[0]) + 2 + len(digits[0]) <= 98


def test_letters_that_are_not_in_the_font_or_no_blocks_give_none():
    assert banner("LÄND", BLOCKS) is None
    assert banner("LAND", "") is None
