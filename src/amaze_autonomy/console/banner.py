"""Large letters, three lines high, of half blocks: read across a field."""

from __future__ import annotations

from typing import List, Mapping, Optional

__all__ = ["banner"]

# Five rows of pixels a letter; "#" is set.
_FONT: Mapping[str, str] = {
    "A": ".##. #..# #### #..# #..#",
    "B": "###. #..# ###. #..# ###.",
    "C": ".### #... #... #... .###",
    "D": "###. #..# #..# #..# ###.",
    "E": "#### #... ###. #... ####",
    "F": "#### #... ###. #... #...",
    "G": ".### #... #.## #..# .###",
    "H": "#..# #..# #### #..# #..#",
    "I": "# # # # #",
    "J": "..# ..# ..# #.# .#.",
    "K": "#..# #.#. ##.. #.#. #..#",
    "L": "#... #... #... #... ####",
    "M": "#...# ##.## #.#.# #...# #...#",
    "N": "#..# ##.# #.## #..# #..#",
    "O": ".##. #..# #..# #..# .##.",
    "P": "###. #..# ###. #... #...",
    "Q": ".##. #..# #..# #.#. .#.#",
    "R": "###. #..# ###. #.#. #..#",
    "S": ".### #... .##. ...# ###.",
    "T": "##### ..#.. ..#.. ..#.. ..#..",
    "U": "#..# #..# #..# #..# .##.",
    "V": "#...# #...# .#.#. .#.#. ..#..",
    "W": "#...# #...# #.#.# ##.## #...#",
    "X": "#..# #..# .##. #..# #..#",
    "Y": "#...# .#.#. ..#.. ..#.. ..#..",
    "Z": "#### ..#. .#.. #... ####",
    "0": ".##. #..# #..# #..# .##.",
    "1": ".# ## .# .# .#",
    "2": "###. ...# .##. #... ####",
    "3": "###. ...# .##. ...# ###.",
    "4": "#..# #..# #### ...# ...#",
    "5": "#### #... ###. ...# ###.",
    "6": ".##. #... ###. #..# .##.",
    "7": "#### ...# ..#. .#.. .#..",
    "8": ".##. #..# .##. #..# .##.",
    "9": ".##. #..# .### ...# .##.",
    ":": ". # . # .",
    " ": ".. .. .. .. ..",
}


def banner(words: str, blocks: str) -> Optional[List[str]]:
    """Return the three lines of the words, all of the same width; None when a letter is not in the font.

    Args:
        words: capital letters, digits, ":" and blanks.
        blocks: the cells with neither half set, the lower, the upper, both; empty: there are no such characters.
    """
    if not blocks or any(letter not in _FONT for letter in words):
        return None
    letters = [_FONT[letter].split() for letter in words]
    pixels = [".".join(letter[row] for letter in letters) for row in range(5)]
    pixels.insert(0, "." * len(pixels[0]))
    return [
        "".join(blocks[2 * (upper == "#") + (lower == "#")] for upper, lower in zip(pixels[row], pixels[row + 1]))
        for row in (0, 2, 4)
    ]
