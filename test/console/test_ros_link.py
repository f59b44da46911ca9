"""The link to the engine without one: what cannot even be sent is answered."""

from __future__ import annotations

from queue import SimpleQueue

import pytest

pytest.importorskip("rospy")

import rospy
from amaze_autonomy.msg import AutonomyState, RecordingStatus
from amaze_autonomy.srv import SelectMission

from amaze_autonomy.console import ros_link
from amaze_autonomy.console.link import AnswerCame, LinkClosed
from amaze_autonomy.console.model import Request, RequestKind, Verdict
from amaze_autonomy.console.ros_link import RosLink
from amaze_autonomy.engine.events import UserCommand
from amaze_autonomy.ros.service_client import ServiceClient

LIMIT_S = 60.0


def answer_to(request, services):
    came = SimpleQueue()
    link = RosLink(came.put, None, quiet=False)
    link._services = services
    link.send(request)
    return came.get(timeout=LIMIT_S)


def test_an_id_that_is_no_utf_8_is_answered():
    """Python hands a byte that is none on as half of a pair: "\\udcff"."""
    client = ServiceClient("/autonomy/select_mission", SelectMission, "http://127.0.0.1:1", "/console")
    answer = answer_to(Request(RequestKind.SELECT, 3, missions=("1\udcff",)), {"select_mission": client})
    words = r"'utf-8' codec can't encode character '\udcff' in position 1: surrogates not allowed"
    assert answer == AnswerCame(3, Verdict.NO_ANSWER, words)


def test_a_landing_that_is_asked_for_before_there_is_a_connection_is_answered():
    answer = answer_to(Request(RequestKind.COMMAND, 3, UserCommand.LAND), {})
    assert answer == AnswerCame(3, Verdict.NO_ANSWER, "not connected yet")


@pytest.mark.parametrize("uri", ["127.0.0.1:11977", "foo://here:1"])
def test_an_address_that_no_master_can_have_closes_the_link(monkeypatch, uri):
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    came = SimpleQueue()
    link = RosLink(came.put, None, quiet=False)
    link.start()
    words = f"No connection to ROS: ROS_MASTER_URI is '{uri}'; must be http://HOST:PORT."
    assert came.get(timeout=LIMIT_S) == LinkClosed(words, failed=True)


class Clock:
    now_s = 500.0

    def monotonic(self):
        return self.now_s


@pytest.mark.parametrize("simulated, ages_s", [(False, [0.0, 0.5, 0.0, 7.0]), (True, [0.0, 0.0, 0.0, 0.0])])
@pytest.mark.parametrize("kind", [AutonomyState, RecordingStatus])
def test_what_was_longer_under_way_or_comes_once_more_is_that_much_older(monkeypatch, kind, simulated, ages_s):
    clock, came = Clock(), []
    monkeypatch.setattr(ros_link, "time", clock)
    monkeypatch.setattr(rospy.rostime, "is_wallclock", lambda: not simulated)
    link = RosLink(came.append, None, quiet=False)
    take = link._on_state if kind is AutonomyState else link._on_recording
    for at_s, stamp_s in ((500.0, 1000), (502.5, 1002), (503.0, 1003), (510.0, 1003)):
        clock.now_s = at_s
        message = kind()
        message.header.stamp = rospy.Time(stamp_s)
        take(message)
    assert [each.age_s for each in came] == pytest.approx(ages_s, abs=0.005)
