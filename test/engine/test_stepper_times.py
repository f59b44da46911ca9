"""Until when the stepper takes for granted what was said, and after what it takes nothing for granted."""

from __future__ import annotations

import pytest
from engine_beginnings import BEGINNINGS
from engine_news import KINDS, again, component, is_news, recording, settled
from engine_peers import SHIPPED, S

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine import stepper as module
from amaze_autonomy.engine.checks import CheckName
from amaze_autonomy.engine.horizon import Horizon, horizon_ns
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.engine.severity import Code, Verb
from amaze_autonomy.engine.state import CheckRecord, EngineState, Failure, FailureKind, evolve
from amaze_autonomy.engine.timers import TIMERS

LIMITS = Limits()


# --- when it comes -------------------------------------------------------------------------------------------------

SILENT_FOR = {
    "action": LIMITS.watchdog_heartbeat_limit_ns,
    "planner": LIMITS.planner_status_limit_ns,
    "recorder": LIMITS.recorder_status_limit_ns,
    "autopilot": LIMITS.autopilot_status_limit_ns,
    "landing": LIMITS.landing_detection_limit_ns,
}


def silence(story, peer, until_ns):
    """Let the others speak until a time."""
    while story.now < until_ns:
        story.now = min(until_ns, story.now + S // 10)
        for other in KINDS:
            if other != peer and getattr(story.state, other) is not None:
                again(story, other, 0)


@pytest.mark.parametrize("peer", KINDS)
@pytest.mark.parametrize("late_ns", [0, 1])
def test_the_first_word_after_silence_is_news(asked, peer, late_ns):
    story = settled("MISSION_ENDED")
    silence(story, peer, story.now + SILENT_FOR[peer] + late_ns)
    asked.clear()
    again(story, peer, 0)
    assert bool(asked) is bool(late_ns)


@pytest.mark.parametrize("known", [{"battery_age_s": 0.1}, {"height_m": 0.0}])
@pytest.mark.parametrize("late_ns", [0, 1])
def test_what_was_unknown_for_too_long_is_news(asked, known, late_ns):
    story = settled("MISSION_ENDED")
    field = next(iter(known))
    since = story.state.battery_ns if field == "battery_age_s" else story.state.position_ns
    end = since + 10 * S + late_ns
    again(story, "autopilot", **{field: None})
    while story.now < end:
        again(story, "autopilot", min(S // 2, end - story.now))
    asked.clear()
    again(story, "autopilot", 0, **known)
    assert bool(asked) is bool(late_ns)


def test_a_link_that_is_back_is_news(asked):
    story = settled("MISSION_ENDED")
    assert is_news(asked, story, "autopilot", link_age_s=3.1)
    assert is_news(asked, story, "autopilot", link_age_s=0.0)
    assert not is_news(asked, story, "autopilot", link_age_s=2.96)
    assert not is_news(asked, story, "autopilot", link_age_s=2.97)  # 0.04 s after the last
    assert is_news(asked, story, "autopilot", link_age_s=0.0)
    assert is_news(asked, story, "autopilot", link_age_s=None)
    assert is_news(asked, story, "autopilot", link_age_s=None)
    assert is_news(asked, story, "autopilot", link_age_s=0.0)


@pytest.mark.parametrize("said, limit_ns", [("link_age_s", 3 * S), ("battery_age_s", 10 * S)])
@pytest.mark.parametrize("late_ns", [0, 1])
def test_an_age_that_a_status_brings_ends_too(asked, said, limit_ns, late_ns):
    """It is told so late that nothing else ends in between."""
    story = settled("MISSION flying")
    assert not is_news(asked, story, "autopilot", **{said: limit_ns / S - 0.05})
    stepper, state = story.stepper
    assert stepper.wakes_ns(state) == story.now + S // 20 + 1
    asked.clear()
    again(story, "landing", S // 20 + late_ns)
    assert bool(asked) is bool(late_ns)


def test_a_watchdog_that_stands_still_is_heard_but_its_heart_does_not_beat(asked):
    story = settled("MISSION flying")
    beat_ns, loop = story.state.heartbeat_ns, story.state.action.loop_counter
    assert not is_news(asked, story, "action", loop_counter=loop)
    assert (story.state.heartbeat_ns, story.state.action.t_ns) == (beat_ns, story.now)
    assert not is_news(asked, story, "action", loop_counter=loop - 1)
    assert story.state.heartbeat_ns == story.now


def test_what_comes_late_is_asked_about(asked):
    story = settled("MISSION flying")
    assert not is_news(asked, story, "landing", pause_ns=0)
    assert is_news(asked, story, "landing", pause_ns=-1)


def test_what_ends_later_by_now_is_looked_up_before_the_table_is_asked(asked):
    story = settled("MISSION_ENDED")
    again(story, "landing")
    stepper, state = story.stepper
    first_ns = stepper.wakes_ns(state)
    while story.now < first_ns - S // 5:
        for peer in ("action", "planner", "autopilot", "landing"):
            again(story, peer, S // 100)
    asked.clear()
    again(story, "landing", first_ns - story.now)
    stepper, state = story.stepper
    assert not asked
    assert stepper.wakes_ns(state) == horizon_ns(state, story.rules) > first_ns


def quiet_until(story, end_ns):
    while story.now < end_ns:
        for peer in ("action", "planner", "autopilot", "landing"):
            again(story, peer, S // 100)


def test_when_it_is_to_be_woken_is_looked_up_again_when_that_time_has_come():
    story = settled("MISSION_ENDED")
    again(story, "landing")
    first_ns = story.stepper[0].wakes_ns(story.stepper[1])
    quiet_until(story, first_ns - S // 5)
    stepper, state = story.stepper
    assert [stepper.wakes_ns(state), stepper.wakes_ns(state, first_ns - 1)] == [first_ns, first_ns]
    assert stepper.wakes_ns(state, first_ns) == horizon_ns(state, story.rules) > first_ns


def test_what_does_not_move_is_collected_once(asked, monkeypatch):
    collected, looked = [], []

    class Counted(Horizon):
        def __init__(self, *arguments):
            collected.append(1)
            super().__init__(*arguments)

        def after(self, state):
            looked.append(1)
            return super().after(state)

    story = settled("MISSION_ENDED")
    story.feed(ev.Tick)
    monkeypatch.setattr(module, "Horizon", Counted)
    asked.clear()
    quiet_until(story, story.now + 3 * S // 2)
    assert (asked, len(collected)) == ([], 1)
    assert len(looked) > 2


# --- what it knows -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "kind, said",
    [
        (ev.Reply, {"command_id": -1, "outcome": ev.Outcome.ACCEPTED}),
        (ev.CheckReply, {"command_id": -1, "check": CheckName.BATTERY, "outcome": ev.Outcome.ACCEPTED}),
        (ev.UserRequest, {"command": ev.UserCommand.GO}),
        (ev.WatchdogAction, {"sequence": 0, "loop_counter": 0, "code": Code(8), "latest_component": "lrf"}),
    ],
)
def test_nothing_is_known_after_what_is_not_a_status_or_what_was_decided(asked, kind, said):
    story = settled("MISSION flying")
    assert not is_news(asked, story, "planner")
    story.feed(kind, **said)
    asked.clear()
    again(story, "planner", 0)
    assert asked


@pytest.mark.parametrize("kind", [ev.Tick, ev.WatchdogInfo, *KINDS.values()])
def test_every_status_that_nothing_came_of_settles(asked, kind):
    story, spoken = settled("MISSION flying"), {each: name for name, each in KINDS.items()}
    story.feed(ev.Reply, command_id=-1, outcome=ev.Outcome.ACCEPTED)
    if kind in spoken:
        again(story, spoken[kind])
    elif kind is ev.WatchdogInfo:
        story.feed(kind, sequence=0, changed=(), components=tuple(story.watchdog.components.values()))
    else:
        story.feed(kind)
    asked.clear()
    again(story, "landing", 0)
    again(story, "planner", 0)
    assert not asked


def test_nothing_is_known_after_a_command(asked):
    story = settled("LAND commanding")
    asked.clear()
    story.now += S // 2
    assert story.feed(ev.Tick)
    again(story, "landing", 0)
    assert len(asked) == 2


def test_when_it_is_to_be_woken_is_known_of_the_last_state_only():
    story = settled("MISSION flying")
    again(story, "landing")
    stepper, state = story.stepper
    assert stepper.wakes_ns(state) > state.t_ns
    assert stepper.wakes_ns(evolve(state)) == 0


def counting(counts, where, name):
    asked = getattr(where, name)

    def counted(*arguments):
        counts[name] += 1
        return asked(*arguments)

    return counted


def test_what_is_looked_up_is_not_looked_up_again_and_again(monkeypatch):
    """What makes the stepper fast: a horizon is found once, components are looked at when they change."""
    story, counts = settled("MISSION flying"), {"after": 0, "_is_calm": 0}
    for name, where in (("after", Horizon), ("_is_calm", module)):
        monkeypatch.setattr(where, name, counting(counts, where, name))
    for _ in range(20):
        for peer in ("action", "planner", "autopilot", "landing"):
            again(story, peer, S // 1000)
        story.feed(ev.Tick)
    assert counts == {"after": 19, "_is_calm": 0}, "each tick is the table's, and after it a horizon is new"


def test_what_is_wrong_is_looked_at_each_time_while_its_words_tell_for_how_long(asked):
    story = settled("MISSION flying")
    for _ in range(2):
        assert not is_news(asked, story, "recorder")
        again(story, "recorder", platforms=recording(True, False))  # a loss
        asked.clear()
        again(story, "planner")
        again(story, "planner")
        assert len(asked) == 2
        again(story, "recorder", platforms=recording(True, True))
        again(story, "recorder")


BEFORE = EngineState(failures=(Failure("lrf", FailureKind.COMPONENT, 8, Verb.WAIT),))


@pytest.mark.parametrize(
    "changes, same",
    [
        ({}, True),
        ({"failures": ()}, False),
        ({"spent": (("lrf", 1),)}, False),
        ({"flown_without": ("lrf",)}, False),
        ({"planner_ns": 1}, True),
    ],
)
def test_what_is_wrong_must_be_as_before(changes, same):
    assert module._same_failures(BEFORE, evolve(BEFORE, **changes)) is same


def test_what_the_watchdog_told_is_news_to_components_that_have_changed_since(asked):
    story, told = settled("MISSION flying"), tuple(component(name, 1) for name in ("gps", "imu", "lrf"))

    def is_told(components, **said):
        story.now += S // 50
        asked.clear()
        story.feed(ev.WatchdogInfo, sequence=0, changed=(), components=components, **said)
        return bool(asked)

    assert is_told(told)
    assert not is_told(told)
    assert not is_told((), age_ns=S + 1)
    assert is_told(told[:2])
    assert is_told(told)
    again(story, "action", components=(component("lrf", 4),), code=Code(4))
    assert is_told(told), "a component that fails is the action stream's to tell"
    assert is_told(told)
    again(story, "action", components=(), code=Code(1))
    story.feed(ev.Tick)
    again(story, "action")
    assert "lrf" not in [status.name for status in story.state.components]
    assert is_told(told)
    assert not is_told(told)


# --- the horizon ---------------------------------------------------------------------------------------------------

FAR = 10**7 * S  # all that begins with 0 has ended
STAMPS = {
    "heartbeat_ns": "watchdog_heartbeat_limit_ns",
    "planner_ns": "planner_status_limit_ns",
    "recorder_ns": "recorder_status_limit_ns",
    "autopilot_ns": "autopilot_status_limit_ns",
    "landing_ns": "landing_detection_limit_ns",
    "battery_ns": "battery_age_limit_ns",
    "position_ns": "position_age_limit_ns",
}


@pytest.mark.parametrize("stamp", STAMPS)
def test_each_status_grows_too_old_after_its_limit(stamp):
    limit_ns = getattr(LIMITS, STAMPS[stamp])
    heard_ns = FAR - 3 * limit_ns // 4
    state = evolve(EngineState(t_ns=FAR, entered_ns=FAR), **{stamp: heard_ns})
    assert horizon_ns(state, SHIPPED) == heard_ns + limit_ns + 1
    assert horizon_ns(evolve(state, t_ns=heard_ns + limit_ns), SHIPPED) == heard_ns + limit_ns + 1
    assert horizon_ns(evolve(state, t_ns=heard_ns + limit_ns + 1), SHIPPED) > heard_ns + limit_ns + 1


def test_what_has_ended_and_what_ends_now_is_no_horizon():
    assert horizon_ns(EngineState(t_ns=FAR), SHIPPED) > 2 * FAR
    silent = EngineState(t_ns=FAR, entered_ns=FAR - LIMITS.recorder_status_limit_ns - 1)
    assert horizon_ns(silent, SHIPPED) > FAR
    assert horizon_ns(evolve(silent, t_ns=FAR - 1), SHIPPED) == FAR


def test_an_answer_that_is_late_and_a_wait_that_ends_are_looked_up():
    limit_ns = LIMITS.check_reply_limit_ns
    first, second = (
        CheckRecord(check=CheckName.BATTERY, command_id=1, asked_ns=FAR - limit_ns + after) for after in (-1, 5)
    )
    state = EngineState(t_ns=FAR, checks=(first, second), watchdog_started_ns=1)
    assert horizon_ns(state, SHIPPED) == FAR + 5
    waits = tuple(Failure("lrf", FailureKind.COMPONENT, 8, Verb.WAIT, deadline_ns=FAR + after) for after in (-1, 5))
    lost = Failure("height", FailureKind.LOSS, 0, Verb.LAND)
    assert horizon_ns(EngineState(t_ns=FAR, failures=(*waits, lost)), SHIPPED) == FAR + 5


@pytest.mark.parametrize("place", list(BEGINNINGS))
def test_no_timer_ends_before_the_horizon(place):
    state = settled(place).state
    ends = [timer.when(state, SHIPPED) for timer in TIMERS]
    assert horizon_ns(state, SHIPPED) <= min(end for end in (*ends, 1 << 62) if end is not None and end > state.t_ns)
