"""The engine: `decide(state, event, rules) -> (state, commands)`, pure.

Standard library only; no clock, no I/O, no threads, no logging, no randomness. Time arrives with the event. What it
knows is one frozen value (`state.py`), what can happen is in `events.py`, what it can ask for in `commands.py`, what a
configuration can say in `rules.py`. What it decides stands in tables: `severity.py`, `conditions.py`, `transitions.py`,
`answers.py`, `messages.py`.
"""
