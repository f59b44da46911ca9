"""The journal: events and decisions as JSON Lines, and what shows the engine's state to people. Pure.

`journal.py` is the file format, `codec.py` makes JSON of any frozen dataclass, `report.py` is what a person is shown of
a state.
"""
