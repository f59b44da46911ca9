"""The link to the engine without one: what cannot even be sent is answered."""

from __future__ import annotations

from queue import SimpleQueue

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.srv import SelectMission

from amaze_autonomy.console.link import AnswerCame
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
