"""A way to a broken law as files: a scenario that `amaze-replay test` decides, and its journal, the events in order.

The header of the journal names the law and the way. Written into `test/proof/found/`, both are regression tests from
then on: every law must hold at every event of it (`test_found.py`), and once the engine is mended and the scenario's
decisions are accepted (`amaze-replay accept`), it must decide them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, List, Tuple

import yaml
from proof_explorer import Broken
from proof_moves import BOOT, Move, perform

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import Event
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState
from amaze_autonomy.journal import journal
from amaze_autonomy.laws import Moment, Witness, judge, observed


def journal_of(path: Tuple[Move, ...], rules: Rules, **about: Any) -> str:
    """Return the journal of a way from boot."""
    header = journal.make_header(rules, {}, "", way=[":".join(move) for move in path], **about)
    lines = [journal.encode_header(header)]

    def observe(moment: Moment) -> None:
        lines.append(journal.encode_event(moment.event))
        lines.extend(journal.encode_decision(c) for c in moment.commands if isinstance(c, Decision))

    node = BOOT
    for move in path:
        node = perform(node, move, rules, observe)
    return "".join(f"{line}\n" for line in lines)


def write(broken: Broken, rules: Rules, folder: Path) -> Path:
    """Write the way to a broken law into a folder, named after the law; return the scenario file."""
    folder.mkdir(parents=True, exist_ok=True)
    number = 1
    while (folder / f"{broken.law}-{number}.jsonl").exists():
        number += 1
    path = folder / f"{broken.law}-{number}.jsonl"
    path.write_text(journal_of(broken.path, rules, law=broken.law, why=broken.why), encoding="ascii")
    return write_scenario(path, broken.law, f"{broken.law} was broken: {broken.why}")


def write_scenario(path: Path, law: str, description: str) -> Path:
    """Write the scenario file of a journal beside it; return it."""
    scenario = path.with_suffix(".scenario.yaml")
    words = {
        "version": 1,
        "description": description[:200],
        "tags": ["proof"],
        "requirements": [law],
        "journal": path.name,
    }
    scenario.write_text(yaml.safe_dump(words, sort_keys=False, width=120), encoding="ascii")
    return scenario


def check_journal(text: str) -> Dict[str, int]:
    """Decide the events of a journal again under all laws; return how often each applied.

    Raises:
        BrokenLawError: A law does not hold.
        JournalError: The text is no journal.
    """
    found = journal.read(text)
    rules = journal.rules_of(found.lines[0])
    events: List[Event] = [line.payload for line in found.lines if isinstance(line.payload, Event)]
    applied: Dict[str, int] = {}
    observe = judge(applied)
    state, witness = EngineState(), Witness()
    for event in events:
        after, commands = engine.decide(state, event, rules)
        moment = observed(witness, state, event, commands, after, rules)
        observe(moment)
        state, witness = after, moment.seen
    return applied
