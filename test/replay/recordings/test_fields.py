"""Values out of messages: paths, numbers, orientations."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest
from replay_bags import START_NS, imu, make

from amaze_autonomy.replay.errors import FieldError
from amaze_autonomy.replay.recordings.fields import getter, number, quaternion, vector


def test_a_path_leads_through_messages_and_arrays():
    message = imu(START_NS, (1.0, 2.0, 3.0))
    assert getter("linear_acceleration.y")(message) == 2.0
    assert vector(getter("linear_acceleration")(message)) == (1.0, 2.0, 3.0)
    assert getter("orientation_covariance[8]")(message) == 0.0


@pytest.mark.parametrize(
    "path,message",
    [
        (
            "linear_acceleration.w",
            "linear_acceleration.w: geometry_msgs/Vector3 has no such field; it has x, y, z",
        ),
        ("orientation_covariance[9]", "orientation_covariance[9]: ndarray has no such field; it has 9 elements"),
        (
            "quality",
            "quality: sensor_msgs/Imu has no such field; it has header, orientation, orientation_covariance, "
            "angular_velocity, angular_velocity_covariance, linear_acceleration, linear_acceleration_covariance",
        ),
    ],
)
def test_a_field_that_is_not_there_is_named_with_those_that_are(path, message):
    with pytest.raises(FieldError) as caught:
        getter(path)(imu(START_NS))
    assert str(caught.value) == message


@pytest.mark.parametrize("value", [nan, inf, -inf, None, "no number", np.float64(nan)])
def test_what_is_no_finite_number_is_none(value):
    assert number(value) is None


@pytest.mark.parametrize("value", [1.5, np.float32(1.5), np.float64(1.5)])
def test_a_number_is_a_plain_float(value):
    assert number(value) == 1.5
    assert type(number(value)) is float


def test_an_orientation_of_zeros_is_none():
    def orientation(x, y, z, w):
        return quaternion(make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w))

    assert orientation(0.0, 0.0, 0.0, 0.0) is None
    assert orientation(0.0, 0.0, 0.0, 2.0) is None
    assert orientation(nan, 0.0, 0.0, 1.0) is None
    assert orientation(0.0, 0.6, 0.0, 0.8) == (0.0, 0.6, 0.0, 0.8)
