"""The simulation node before it starts: whose vehicle it would have flown."""

from __future__ import annotations

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.config import load_configuration
from amaze_autonomy.nodes.simulation import node
from amaze_autonomy.paths import config_folder
from amaze_autonomy.ros.errors import StartError


def given(monkeypatch, **parameters):
    monkeypatch.setattr(node.rospy, "get_param", lambda name, default=None: parameters.get(name[1:], default))


@pytest.mark.parametrize("vehicle", ["px4", "ardupilot"])
def test_a_simulated_vehicle_is_never_flown_through_a_mavros_that_may_have_a_real_one_behind_it(monkeypatch, vehicle):
    given(monkeypatch, vehicle=vehicle)
    configuration = load_configuration(config_folder(), ["autopilot.backend=mavros"])
    with pytest.raises(StartError) as caught:
        node._flown(configuration, None, 0, 0)
    assert str(caught.value) == (
        "autopilot.yaml: backend is mavros, and the simulated vehicle is reached over MAVLink alone; "
        "start with flight:=simulated, or override autopilot.backend=mavlink"
    )


def test_over_mavlink_it_is_flown(monkeypatch):
    given(monkeypatch, vehicle="px4")
    world, serve = node._flown(load_configuration(config_folder()), None, 0, 0)
    assert world.vehicle is not None
    assert callable(serve)
