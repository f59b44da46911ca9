"""What a platform's recorders were told to record, and what of it another copy of the configuration lacks."""

import pytest

from amaze_autonomy.recording.status import common, configured, lacking

IMAGE, DEPTH, IMU = (f"/realsense/{name}" for name in ("image", "depth", "imu"))


def topics_lacking(*listed):
    """Return whether /realsense/depth lacks in a part whose list has these groups."""
    groups = {f"group{number}": each for number, each in enumerate(listed)}
    topics, expressions = lacking({"configured": groups}, {"realsense": configured([DEPTH])})
    assert expressions == []
    return topics


def test_a_topic_is_recorded_by_its_name_in_whatever_group():
    assert topics_lacking(configured([IMAGE]), configured([DEPTH])) == []
    assert topics_lacking(configured([IMAGE])) == topics_lacking() == [DEPTH]


def test_a_topic_may_be_recorded_by_an_expression():
    assert topics_lacking(configured([IMAGE], ["/real.*"])) == []
    assert topics_lacking(configured([IMAGE], ["real.*"])) == [DEPTH], "an expression matches the whole name"
    assert topics_lacking(configured([DEPTH], ["/real.*"], ".*/depth")) == [DEPTH], "it is excluded"
    assert topics_lacking(configured([DEPTH], [], ".*/depth")) == [], "rosbag is told so with expressions only"
    assert topics_lacking(configured([IMAGE], ["(?|/real.*)"])) == [DEPTH], "what Python does not read matches nothing"


@pytest.mark.parametrize("content", [{}, {"configured": None}, {"configured": {"a": {}}}, {"configured": {"a": "b"}}])
def test_of_a_list_that_does_not_say_what_was_to_be_recorded_nobody_knows(content):
    """An own recorder's that has files alone, or an earlier version's."""
    wanted = {"a": configured(["/a"], ["/b.*"])}
    assert lacking({"files": [], "topics": {}, **content}, wanted) == ([], [])


def test_recorders_that_were_told_one_thing_and_then_another_recorded_what_both_have():
    one, other = configured([IMAGE, DEPTH], ["/a", "/b"]), configured([IMU, IMAGE], ["/b"], "/b/raw")
    assert common(one, other) == common(other, one) == configured([IMAGE], ["/b"], "/b/raw")
    assert common(other, other) == other
    assert common(other, configured([IMAGE], ["/b"], "/c"))["exclude"] == "/b/raw|/c"
