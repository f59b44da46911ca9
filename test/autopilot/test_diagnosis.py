from __future__ import annotations

import pytest

from amaze_autonomy.autopilot import LinkState
from amaze_autonomy.autopilot.link.connection import link_problem

S = 1_000_000_000
GOOD = LinkState(True, "", 1, 5, (), (), 100, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    "different, words",
    [
        ({}, ""),
        ({"problem": "Connection refused"}, "Connection refused"),
        ({"heartbeat_ns": None}, "no vehicle heard yet"),
        ({"heartbeat_ns": None, "refused": 7}, "no message has a good signature"),
        ({"heartbeat_ns": None, "others": (2, 3)}, "no vehicle 1; heard are 2, 3: see vehicle_id"),
        ({"heartbeat_ns": None, "frames": 0, "damaged_bytes": 5000}, "only noise is heard: is the baud rate right"),
        ({"strangers": ("10.0.0.2:5",)}, "another vehicle says system id 1, from 10.0.0.2:5; it is ignored"),
        (
            {"strangers": ("mavros, where ours is, too",), "mixed": True},
            "another vehicle is heard (mavros, where ours is, too), and it is taken for ours: let mavros hear one",
        ),
        ({"doubles": 3}, "somebody else speaks with our own"),
        ({"others": (2,), "refused": 1}, ""),
        ({"errors": 1}, "a message could not be dealt with"),
    ],
)
def test_what_is_wrong_is_said_so_that_it_can_be_put_right(different, words):
    said = link_problem(GOOD._replace(**different), 4 * S)
    assert said.startswith(words)
    assert bool(said) is bool(words)


@pytest.mark.parametrize("at_s", [6, 60])
@pytest.mark.parametrize(
    "different, words",
    [
        ({}, "vehicle 1 has fallen silent: no heartbeat for 5 s"),
        ({"vehicle": None}, "the vehicle has fallen silent: no heartbeat for 5 s"),
        ({"errors": 1, "doubles": 3}, "vehicle 1 has fallen silent: no heartbeat for 5 s"),
        ({"problem": "silent for 5 s"}, "silent for 5 s"),
        ({"heartbeat_ns": None}, "no vehicle heard yet"),
        ({"strangers": ("10.0.0.2:5",)}, "another vehicle says system id 1, from 10.0.0.2:5"),
    ],
)
def test_a_vehicle_that_has_fallen_silent_is_told_in_words_that_stay_the_same(different, words, at_s):
    assert link_problem(GOOD._replace(**different), at_s * S).startswith(words)
