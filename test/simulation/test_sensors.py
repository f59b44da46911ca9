"""What the sensors publish when the world is live: the messages of each stream, as plain values."""

from math import isnan

import pytest
from simulation_tools import Driver, S

from amaze_autonomy.simulation.streams import SampleKind


def sent(faults="", seconds=4.0, from_s=0.0, settings=None):
    """Return the samples of a live world, by topic."""
    driver = Driver(faults, live=True, settings=settings)
    driver.go_on(from_s)
    driver.world.samples()
    driver.go_on(seconds)
    topics = {}
    for sample in driver.world.samples():
        topics.setdefault(sample.topic, []).append(sample)
    return topics


def test_every_topic_of_the_shipped_configuration_is_sent_at_its_rate(configuration):
    topics = sent(settings=configuration, seconds=10.0)
    for component in configuration.components:
        for topic in component.topics:
            assert len(topics[topic.topic]) == pytest.approx(10 * topic.rate_hz, abs=2)
    assert len(topics[configuration.state_estimation.topic]) == pytest.approx(300, abs=2)


def test_the_types_are_those_that_the_names_suggest(configuration):
    topics = sent(settings=configuration)
    assert {name: samples[0].type_name for name, samples in topics.items()} == {
        "/px4/gps": SampleKind.FIX,
        "/px4/imu": SampleKind.IMU,
        "/px4/magnetometer": SampleKind.FIELD,
        "/px4/barometer": SampleKind.PRESSURE,
        "/mission_camera/image_raw": SampleKind.IMAGE,
        "/realsense/image_raw": SampleKind.IMAGE,
        "/realsense/imu": SampleKind.IMU,
        "/lsm9ds1/imu": SampleKind.IMU,
        "/lrf/range": SampleKind.RANGE,
        "/odometry": SampleKind.ODOMETRY,
    }


def test_stamps_rise_and_belong_to_the_time_that_has_passed(configuration):
    streams = sent(settings=configuration, from_s=2.0)
    assert streams
    for samples in streams.values():
        stamps = [sample.stamp_ns for sample in samples]
        assert stamps == sorted(stamps)
        assert stamps[0] > 1.8 * S
        assert stamps[-1] <= 6 * S


def test_samples_are_handed_over_once():
    driver = Driver(live=True)
    driver.go_on(1.0)
    assert driver.world.samples() != ()
    assert driver.world.samples() == ()


def test_a_world_that_is_not_live_makes_none():
    driver = Driver()
    driver.go_on(1.0)
    assert driver.world.samples() == ()


def test_a_picture_is_whole_and_changes_with_each_one():
    pictures = [sample.fields for sample in sent()["/camera"]]
    first = pictures[0]
    assert len(first["data"]) == first["height"] * first["step"]
    assert (first["encoding"], first["step"]) == ("mono8", first["width"])
    assert pictures[0]["data"] != pictures[1]["data"]


def test_a_stuck_camera_sends_the_same_picture():
    pictures = {
        sample.fields["data"] for sample in sent("component: camera, fault: stuck, at_s: 1", from_s=2.0)["/camera"]
    }
    assert len(pictures) == 1


def test_at_rest_gravity_points_down_and_on_a_slope_it_does_not():
    level = sent()["/px4/imu"][-1].fields["linear_acceleration"]
    assert (level["x"], level["y"], level["z"]) == pytest.approx((0.0, 0.0, 9.807), abs=0.05)
    slope = sent("fault: tilted, tilt_deg: 30")["/px4/imu"][-1].fields["linear_acceleration"]
    assert (slope["x"], slope["z"]) == pytest.approx((-4.903, 8.493), abs=0.05)


def test_the_range_on_the_ground_is_the_height_of_the_sensor():
    reading = sent()["/lrf/range"][-1].fields
    assert reading["range"] == pytest.approx(0.1, abs=0.01)
    assert reading["min_range"] < reading["range"] < reading["max_range"]


def test_a_broken_range_finder_says_nan_or_the_same_for_ever():
    assert isnan(sent("component: lrf, fault: nan")["/lrf/range"][-1].fields["range"])
    stuck = [s.fields["range"] for s in sent("component: lrf, fault: stuck, at_s: 1", from_s=2.0)["/lrf/range"]]
    assert len(set(stuck)) == 1
    reads = sent("component: lrf, fault: reads, value_m: 0.7")["/lrf/range"][-1].fields["range"]
    assert reads == pytest.approx(0.7)


def test_the_odometry_follows_the_vehicle():
    driver = Driver(live=True)
    driver.take_off()
    driver.until(lambda: driver.vehicle.reached == 2)
    driver.world.samples()
    driver.go_on(0.2)
    odometry = [sample for sample in driver.world.samples() if sample.topic == "/odometry"][-1].fields
    position = odometry["pose"]["pose"]["position"]
    assert tuple(position.values()) == pytest.approx(driver.vehicle.position_m, abs=0.3)
    assert len(odometry["pose"]["covariance"]) == 36
    assert set(odometry["twist"]["twist"]["linear"]) == {"x", "y", "z"}


def test_a_silent_sensor_sends_nothing():
    assert "/camera" not in sent("component: camera, fault: silent")
