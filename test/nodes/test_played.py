"""What a node has received, out of its answer to getBusStats; what recorded peers answer."""

from __future__ import annotations

import pytest

pytest.importorskip("rospy")

import rospy

from amaze_autonomy.engine.events import Outcome
from amaze_autonomy.interface import SERVICES
from amaze_autonomy.nodes.simulation.recorded_peers_node import ANSWERS, Reception, listeners, receptions, unconnected
from amaze_autonomy.ros.errors import StartError
from amaze_autonomy.ros.interface import SERVICE_CLASSES

STATS = [
    [["/watchdog/info", 100, [[7, 100, 2, True]]]],
    [
        ["/lrf/range", [[3, 4000, 355, -1, True]]],
        ["/clock", [[1, 9, 8, -1, True], [2, 9, 1, -1, False]]],
        ["/odom", []],
    ],
    [],
]


@pytest.mark.parametrize("given, names", [("/a,b", ("/a", "b")), (" /a , ", ("/a",)), (7, ("7",))])
def test_the_listeners_are_names_with_commas_between(monkeypatch, given, names):
    monkeypatch.setattr(rospy, "get_param", lambda name, default: {"~listeners": given}.get(name, default))
    assert listeners() == names


@pytest.mark.parametrize("given", [{}, {"~listeners": ""}, {"~listeners": " , "}])
def test_listeners_that_nobody_named_are_asked_for_in_one_line(monkeypatch, given):
    monkeypatch.setattr(rospy, "get_param", given.get)
    with pytest.raises(StartError, match=r"^~listeners names no node that must be connected before it begins, "):
        listeners()


def test_messages_are_told_by_topic_over_all_its_connections():
    assert receptions("/watchdog", STATS) == (
        Reception("/clock", "/watchdog", 9, 2),
        Reception("/lrf/range", "/watchdog", 355, 1),
        Reception("/odom", "/watchdog", 0, 0),
    )
    assert receptions("/watchdog", []) == ()


def test_who_is_not_connected_to_what_it_wants_is_named():
    there = receptions("/watchdog", STATS)
    assert unconnected({"/watchdog": ["/lrf/range"]}, there) == []
    assert unconnected({"/watchdog": ["/odom", "/imu"], "/autonomy": ["/clock"]}, there) == [
        "/watchdog to /odom",
        "/watchdog to /imu",
        "/autonomy to /clock",
    ]


def test_every_service_of_a_peer_that_does_not_run_live_is_answered_with_yes():
    live = ("watchdog/", "landing_detection/", "state_estimation/")
    assert set(ANSWERS) == {name for name in SERVICES if not name.startswith(live)}
    for name, (kind, fields) in ANSWERS.items():
        assert kind is SERVICE_CLASSES[name]
        reply = SERVICES[name].reply(kind._response_class(**fields), 1, 0)
        assert reply.outcome is Outcome.ACCEPTED
        assert getattr(reply, "ok", True)
