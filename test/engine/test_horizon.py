"""What is collected once for a settled state is not moved by quiet events; so both ways find the same horizon."""

from __future__ import annotations

import pytest
from engine_beginnings import BEGINNINGS
from engine_news import KINDS, again, settled
from engine_peers import SHIPPED, S

from amaze_autonomy.engine.horizon import MOVING, Horizon, horizon_ns
from amaze_autonomy.engine.state import evolve
from amaze_autonomy.engine.timers import TIMERS

STAMPS = ("heartbeat_ns", "planner_ns", "recorder_ns", "autopilot_ns", "landing_ns", "battery_ns", "position_ns")
WORDS = ("action", "planner", "recorder", "autopilot", "landing")
QUIET = {"t_ns", *STAMPS, *WORDS}
FIXED = [timer for timer in TIMERS if timer.name not in MOVING]


def differing(one, other):
    return {name for name, value in vars(one).items() if value != getattr(other, name)}


@pytest.mark.parametrize("place", list(BEGINNINGS))
def test_no_quiet_event_moves_what_was_collected(asked, place):
    """Every word and every stamp that a quiet event may change, changed: no other timer ends at another time."""
    story = settled(place)
    for peer in KINDS:
        if getattr(story.state, peer) is None:
            continue
        before = story.state
        asked.clear()
        again(story, peer, 1)
        assert asked or differing(before, story.state) <= QUIET
    state = story.state
    changes = {name: getattr(state, name) + S // 50 for name in STAMPS if getattr(state, name) is not None}
    if state.autopilot is not None:
        changes["autopilot"] = evolve(state.autopilot, link_age_s=0.01, height_m=7.0, battery_age_s=0.5)
    changes.update({name: evolve(getattr(state, name), age_ns=5) for name in WORDS[:3] if getattr(state, name)})
    later = evolve(state, t_ns=state.t_ns + S // 50, **changes)
    assert [timer.when(later, SHIPPED) for timer in FIXED] == [timer.when(state, SHIPPED) for timer in FIXED]
    horizon = Horizon(state, SHIPPED)
    assert horizon.after(state) == horizon_ns(state, SHIPPED)
    assert horizon.after(later) == horizon_ns(later, SHIPPED)


def test_every_timer_that_a_stamp_moves_is_known():
    """Each of the named timers is moved somewhere, and there are no others of that name."""
    moved = set()
    for place in BEGINNINGS:
        state = settled(place).state
        changes = {name: getattr(state, name) + S for name in STAMPS if getattr(state, name) is not None}
        later = evolve(state, **changes)
        moved |= {timer.name for timer in TIMERS if timer.when(later, SHIPPED) != timer.when(state, SHIPPED)}
    assert moved == MOVING
