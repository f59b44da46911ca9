"""The journal: events and decisions as JSON Lines, and what else shows the engine's state and tables to people. Pure.

`journal.py` is the file format, `codec.py` makes JSON of any frozen dataclass, `report.py` is what a person is shown of
a state, `documents.py` writes the engine's tables into docs/.
"""
