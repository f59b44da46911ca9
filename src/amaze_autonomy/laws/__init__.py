"""The laws of the engine, as an outsider judges them: who sees each event and each command, and keeps books of his own.

They share no table with the engine. `flight`, `ground` and `requests` hold them, `witness` the books, and
`judge` applies them to any sequence: the explorer's, a journal's, a scenario's, a live flight's.
"""

from .judge import Broken, BrokenLawError, Judge, Judged, check, judge, observed
from .moment import LAWS, Law, Moment
from .witness import Witness

__all__ = [
    "LAWS",
    "Broken",
    "BrokenLawError",
    "Judge",
    "Judged",
    "Law",
    "Moment",
    "Witness",
    "check",
    "judge",
    "observed",
]
