"""Say what goes wrong all the time again only after a while, each subject for itself.

The `log..._throttle` of rospy count by the line of code that calls them: of two topics that are read by the same code
and are both damaged, the one that is damaged more often would be the only one that is ever named.
"""

from __future__ import annotations

import time
from typing import Dict

import rospy

_said_s: Dict[str, float] = {}


def logerr_seldom(again_s: float, subject: str, words: str) -> None:
    """Log an error, unless one of the same subject was logged lately; from any thread.

    Args:
        again_s: time in which it is not said again.
        subject: what the words are about, e.g. a topic; one of few, since they are remembered.
        words: the text.
    """
    now_s = time.monotonic()
    last_s = _said_s.get(subject)
    if last_s is None or now_s - last_s >= again_s:
        _said_s[subject] = now_s
        rospy.logerr(words)
