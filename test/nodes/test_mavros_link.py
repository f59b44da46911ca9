"""The link through mavros without ROS: which service is called, for how long, and what is not called any more."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.mavros.requests import LATE_NS, Lane, request_of
from amaze_autonomy.autopilot.vehicle.client import CLIENT_MESSAGES
from amaze_autonomy.nodes.vehicle import mavros_link
from amaze_autonomy.nodes.vehicle.mavros_link import MavrosLink
from amaze_autonomy.ros.errors import CallTimeoutError

LIMIT_S = 5.0
PX4 = mavlink.MAV_AUTOPILOT_PX4


def command(number, *parameters):
    given = (*parameters, *[0.0] * (7 - len(parameters)))
    return request_of(mavlink.MAVLink_command_long_message(1, 1, number, 0, *given), PX4)


LAND, MISSION = command(176, 1.0, 4.0, 6.0), command(176, 1.0, 4.0, 4.0)
ARM, INTERVAL = command(400, 1.0), command(511, 0.0)


class Services:
    """Those of mavros: what was called, in order; a service that hangs answers when it is told to."""

    def __init__(self):
        self.called, self.hanging, self.kept = [], {}, []
        self.changed = threading.Condition()

    def client(self, name, _service, _master, _caller):
        def ask(_limit_s, **fields):
            with self.changed:
                self.called.append(fields.get("custom_mode", fields.get("command")))
                self.changed.notify_all()
            goes_on = self.hanging.get(name)
            if goes_on is not None and not goes_on.wait(LIMIT_S):
                raise CallTimeoutError("did not answer within the limit")
            return SimpleNamespace(success=True, mode_sent=True, result=0)

        def keep(_limit_s):
            with self.changed:
                self.kept.append(name)
                self.changed.notify_all()

        return SimpleNamespace(name=name, ask=ask, keep=keep)

    def wait(self, expected):
        return self.until(lambda: expected in self.called)

    def until(self, condition):
        with self.changed:
            return self.changed.wait_for(condition, LIMIT_S)


@pytest.fixture
def services(monkeypatch):
    made = Services()
    monkeypatch.setattr(mavros_link, "_imported", lambda _module, _name: None)
    monkeypatch.setattr(mavros_link, "ServiceClient", made.client)
    monkeypatch.setattr(mavros_link, "_LOOK_S", 0.01)
    return made


@pytest.fixture
def link(services):
    client = SimpleNamespace(receive=lambda *_: (), wake=lambda *_: (), key=lambda *_: None)
    made = MavrosLink("/mavros", client, CLIENT_MESSAGES, lambda: 0, lambda _: None)
    made._announce = lambda: None
    threads = [threading.Thread(target=made._serve, args=(lane,)) for lane in Lane]
    made.begin = lambda: [each.start() for each in threads]
    yield made
    for goes_on in services.hanging.values():
        goes_on.set()
    made._ended.set()
    for each in threads:
        if each.ident is not None:
            each.join(LIMIT_S)


@pytest.mark.live
@pytest.mark.parametrize("hanging", [ARM, INTERVAL], ids=["arming", "interval"])
def test_a_landing_waits_for_no_command_that_hangs(link, services, hanging):
    services.hanging["/mavros/cmd/command"] = threading.Event()
    link.begin()
    link._enqueue(hanging)
    assert services.wait(hanging.command)
    link._enqueue(LAND)
    assert services.wait("AUTO.LAND")


@pytest.mark.live
def test_what_waited_behind_a_service_that_hung_is_not_sent_any_more_but_for_a_landing(link, services, monkeypatch):
    goes_on = services.hanging["/mavros/set_mode"] = threading.Event()
    now_ns = [0]
    monkeypatch.setattr(mavros_link.time, "monotonic_ns", lambda: now_ns[0])
    link.begin()
    link._enqueue(command(176, 1.0, 4.0, 3.0))
    assert services.wait("AUTO.LOITER")
    for request in (MISSION, LAND):
        link._enqueue(request)
    now_ns[0] += LATE_NS + 1
    goes_on.set()
    assert services.wait("AUTO.LAND")
    assert services.called == ["AUTO.LOITER", "AUTO.LAND"]
    assert link.state.unsent == 1


@pytest.mark.live
def test_what_is_commanded_has_a_connection_that_stays_open(link, services):
    link.begin()
    assert services.until(lambda: {*services.kept} == {"/mavros/set_mode", "/mavros/cmd/command"}), services.kept
    assert services.called == []
