"""The engine: `decide(state, event, rules) -> (state, commands)`, pure.

Standard library only; no clock, no I/O, no threads, no logging, no randomness. Time arrives with the event. To be read
in this order: `rules.py` and `failsafe.py` (the tables of what is done about a failure), `transitions.py` (every way
from one state to another), `decide.py`. `state.py` has what it knows, `events.py` what can happen, `commands.py` what
it asks for and says. `update.py` puts an event into the state, `effects.py` is done on the way into a state,
`timers.py` are the waits, `guards.py` and `flight_guards.py` the conditions, all on a `context.Context`.
"""
