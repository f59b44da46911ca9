#!/usr/bin/env python3
"""The autonomy node with rules of its transition table taken out: a test of such an engine must fail."""

from __future__ import annotations

import sys

from amaze_autonomy.engine import transitions


def cripple(rules: list[str]) -> None:
    """Take rows out of the table that `decide` reads."""
    known = {row.rule for row in transitions.TRANSITIONS}
    unknown = set(rules) - known
    if unknown:
        raise SystemExit(f"no such rules: {', '.join(sorted(unknown))}")
    for place, rows in transitions.ROWS_AT.items():
        transitions.ROWS_AT[place] = tuple(row for row in rows if row.rule not in rules)


if __name__ == "__main__":
    OPTION = "--without-rule="
    cripple([word[len(OPTION) :] for word in sys.argv if word.startswith(OPTION)])
    sys.argv = [word for word in sys.argv if not word.startswith(OPTION)]
    from amaze_autonomy.nodes.autonomy.node import main

    raise SystemExit(main())
