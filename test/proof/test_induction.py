"""From any sound state, any event leads to a sound state and breaks no law; and it would be noticed if it did not."""

from __future__ import annotations

import sys
from operator import attrgetter
from random import Random

import proof_peers
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from proof_defects import entering, takes
from proof_figures import by_day, differences, figures_of, read
from proof_induction import FIELDS, LEFT_ALONE, drawn_state, drawn_step, induction, inductions, templates, told
from proof_run import SEED, STEPS, Proof
from proof_sound import FIELDS_OF_A_STATE, SENTENCES, sound
from test_defects import row, without

from amaze_autonomy.engine import effects, update
from amaze_autonomy.engine.commands import Seen
from amaze_autonomy.engine.events import EngineStarted
from amaze_autonomy.engine.state import Agreement, State, Step, put
from amaze_autonomy.engine.transitions import STEPS as PLACES

SEEDS = by_day(range(2, 1000), read(), 1)
"""One that the commit draws, where the accepted steps were taken of these very sources; else all."""


@pytest.mark.skipif(sys.version_info < (3, 9), reason="done once, on the newer Python")
@pytest.mark.xdist_group("induction")
@pytest.mark.parametrize(
    "steps, seed",
    [
        pytest.param(STEPS // 5, SEEDS[0], id="drawn"),
        pytest.param(STEPS, SEED, marks=[pytest.mark.night] if len(SEEDS) == 1 else [], id="accepted"),
    ],
)
def test_no_step_from_any_drawn_state_breaks_anything(steps, seed):
    found = inductions(steps, seed, 1)
    assert [told(each) for each in found.broken] == []
    if seed == SEED:
        assert differences(read(), figures_of(Proof(), {}, found), "induction") == ()


@settings(max_examples=150, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow], deadline=None)
@given(rng=st.randoms(use_true_random=False))
def test_what_hypothesis_draws_breaks_nothing_and_would_be_shrunk(rng):
    drawn = drawn_state(rng)
    assume(drawn is not None)
    broken = drawn_step(rng, drawn, {})
    assert broken is None, told(broken)


def test_every_place_is_drawn_from():
    places = {(t.state.state, t.state.step) for t in templates()}
    expected = {(state, step) for state in State for step in PLACES.get(state, (Step.NONE,))}
    assert places == expected
    assert [(t.place, sound(t.state, t.rules)) for t in templates() if sound(t.state, t.rules)] == []


def test_every_field_of_the_state_is_drawn_or_left_alone_for_a_reason():
    assert {*FIELDS, *LEFT_ALONE} == {*FIELDS_OF_A_STATE}
    assert not set(FIELDS) & set(LEFT_ALONE)


def test_the_same_seed_draws_the_same_steps():
    one, other = induction(400, 5), induction(400, 5)
    assert (one.steps, one.rejected, one.places, one.applied) == (
        other.steps,
        other.rejected,
        other.places,
        other.applied,
    )


# --- would it notice? -------------------------------------------------------------------------------------------------


def forgets(effect, *names):
    """Carry out an effect, but leave some fields as they were."""

    def forgetful(turn):
        before = {name: attrgetter(name)(turn.state) for name in names}
        effect(turn)
        for name, value in before.items():
            turn.state = put(turn.state, name, value)

    return forgetful


def _restart_believes(turn, event):
    turn.set(label=event.label, started_ns=turn.now)


def _late_answers_open_others(turn):
    if not isinstance(turn.event, update.CheckReply):
        _expire(turn)


_expire = update._expire_checks
ARMING = (State.TAKEOFF, Step.ARMING)
DEFECTS = {
    **{
        f"a takeoff keeps {name}": entering(ARMING, forgets(effects.take_off, name))
        for name in (
            "landing.alarmed",
            "landing.overdue_alarmed",
            "landing.armed_alarmed",
            "landing.lost_alarmed",
            "landing.both_routes",
            "landing.second_route_ns",
            "flight.spent",
            "flight.was_airborne",
        )
    },
    "the data's collection keeps the landing": entering(
        (State.DATA_CLEANUP, Step.NONE), forgets(effects.clean_up, "landing.since_ns")
    ),
    "the data's collection keeps the flight": entering(
        (State.DATA_CLEANUP, Step.NONE), forgets(effects.clean_up, "flight.active")
    ),
    "PILOT keeps the commands": entering((State.PILOT, Step.NONE), forgets(effects.pilot, "flight.commanded")),
    "PILOT keeps the missions to come": entering((State.PILOT, Step.NONE), forgets(effects.pilot, "queue")),
    "what was said before a restart is known": takes(EngineStarted, _restart_believes),
    "a late answer leaves the others open": lambda patch: patch.setattr(
        update, "_expire_checks", _late_answers_open_others
    ),
    "`land` is left out": without("land"),
    "`pilot_took_over` is left out": without("pilot_took_over"),
    "`land_repeat` is left out": without("land_repeat"),
    "`ready_revoked` is left out": without("ready_revoked"),
    "a hold goes on although something is waited for": row("resume", guard=lambda _: Seen()),
}


_SEEDS = 5
_PLACES = {"a takeoff": "loaded", "a hold": "holding"}
"""Where a defect shows that any place would show as well, after many more steps."""


_RARE = ("a takeoff keeps flight.was_airborne", "PILOT keeps the missions to come")
"""They show in so few steps that the search takes a minute."""


@pytest.mark.parametrize(
    "words", [pytest.param(words, marks=[pytest.mark.night] if words in _RARE else []) for words in DEFECTS]
)
def test_a_defect_is_found(words, monkeypatch):
    templates()
    monkeypatch.setattr(proof_peers, "_KEPT", {})
    DEFECTS[words](monkeypatch)
    place = next((place for begin, place in _PLACES.items() if words.startswith(begin)), "")
    found = (induction(40_000, seed, place=place) for seed in range(1, _SEEDS + 1))  # most by the first
    assert any(each.broken for each in found), f"not found in {_SEEDS} times 40,000 steps"


@pytest.mark.parametrize("number", range(len(SENTENCES)), ids=[words for words, _ in SENTENCES])
def test_each_sentence_can_be_untrue(number):
    """A sentence that nothing contradicts says nothing."""
    words, holds = SENTENCES[number]
    rng = Random(number)
    for _ in range(20_000):
        template = rng.choice(templates())
        state = template.state
        for name in rng.sample(tuple(FIELDS), 3):
            state = put(state, name, FIELDS[name](rng, state))
        for name, value in _elsewhere(rng, state).items():
            state = put(state, name, value)
        if not holds(state):
            return
    pytest.fail(f"always true: {words}")


def _elsewhere(rng, state):
    """Return fields that are never drawn, or always of their template."""
    step = rng.choice(list(Step))
    changes = ({"step": step}, {"next_id": 0}, {"session.id": "another"}, {"recording.asked": False}, {})
    twice = state.peers.components * 2 or state.peers.components
    other = {"peers.components": twice, "preflight.checks": state.preflight.checks[:3]}
    down = Agreement(state.t_ns, state.t_ns + 1)
    later = {"entered_ns": state.t_ns + 1, "vehicle.down": down, "flight.spent": (("lrf", -1),)}
    return rng.choice((*changes, other, later, {"state": rng.choice(list(State))}))
