"""What goes wrong all the time is said again seldom, each subject for itself."""

from __future__ import annotations

import pytest

pytest.importorskip("rospy")

import rospy

from amaze_autonomy.ros import rospy_flaws
from amaze_autonomy.ros.rospy_flaws import logerr_seldom


class Clock:
    now_s = 1000.0

    def monotonic(self):
        return self.now_s


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(rospy_flaws, "time", clock)
    monkeypatch.setattr(rospy_flaws, "_said_s", {})
    return clock


def test_each_subject_is_said_at_once_and_again_after_its_time(monkeypatch, clock):
    said = []
    monkeypatch.setattr(rospy, "logerr", said.append)
    for at_s in (1000.0, 1004.0, 1009.9, 1010.0, 1014.0):
        clock.now_s = at_s
        for subject in ("one", "another")[: 1 + (at_s >= 1004.0)]:
            logerr_seldom(10.0, subject, f"{subject} at {at_s:g}")
    assert said == ["one at 1000", "another at 1004", "one at 1010", "another at 1014"]


@pytest.mark.usefixtures("clock")
def test_words_are_said_as_they_are(monkeypatch):
    said = []
    monkeypatch.setattr(rospy, "logerr", said.append)
    logerr_seldom(10.0, "subject", "100 % of it: %s %d")
    assert said == ["100 % of it: %s %d"]
