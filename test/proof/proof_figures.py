"""The figures of a proof as a golden: what was explored, reached and caught, accepted by a person with a reason.

They change with every change of the engine, of a law or of a world. What changed is named, figure by figure; nobody
needs to guess from one number whether a law has fallen silent or a row of the table can no longer be reached.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import subprocess
import sys
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

from proof_defects import Caught
from proof_explorer import AND, Stats
from proof_induction import Induction
from proof_run import Proof

from amaze_autonomy.engine.rules import LimitRow, Limits

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ACCEPTED = HERE / "accepted.json"
KEPT = ROOT / "build" / "proof.json"
OF_NO_RUN = ("reason", "sources")
_LOADED = """
import sys, proof_figures
print(*(module.__file__ for module in [*sys.modules.values()] if getattr(module, "__file__", None)), sep="\\n")
"""


@dataclass(frozen=True)
class Figures:
    """What came of a proof.

    Args:
        worlds: name -> states, transitions, lies, depth, handed over, cut off.
        laws: name -> how often it applied.
        compared: pairs of states that count as one.
        rules, places, failures: that were reached.
        reached: world -> what it reached of these, and the laws that applied in it, with semicolons between.
        decided: world -> kind of command -> how many, and a digest of their contents.
        defects: words -> law, world, moves.
        induction: its steps, drawn states, states that were drawn and are not sound, laws that applied.
        limits: those that ship, and what each may be: no world flies by them, since each has shorter ones of its own.
        reason: why they are right, once they are accepted.
        sources: a digest of all that the run depended on (`fingerprint`).
    """

    worlds: Dict[str, Dict[str, int]]
    laws: Dict[str, int]
    compared: int
    rules: Tuple[str, ...]
    places: Tuple[str, ...]
    failures: Tuple[str, ...]
    defects: Dict[str, Dict[str, Any]]
    reached: Dict[str, str] = field(default_factory=dict)
    decided: Dict[str, Dict[str, str]] = field(default_factory=dict)
    induction: Dict[str, int] = field(default_factory=dict)
    limits: Dict[str, Dict[str, float]] = field(default_factory=dict)
    reason: str = ""
    sources: str = ""


def figures_of(proof: Proof, caught: Mapping[str, Optional[Caught]], steps: Induction) -> Figures:
    """Return the figures of a proof in which nothing was broken and no defect missed."""
    reached = proof.reached
    return Figures(
        worlds={name: _counted(stats) for name, stats in proof.stats.items()},
        laws=dict(proof.applied),
        compared=sum(stats.compared for stats in proof.stats.values()),
        rules=tuple(sorted(reached.rules)),
        places=tuple(sorted(" ".join(place).strip() for place in reached.places)),
        failures=tuple(sorted(" -> ".join(pair) for pair in reached.failures)),
        defects={words: by._asdict() for words, by in caught.items() if by is not None},
        reached={name: stats.reached for name, stats in proof.stats.items()},
        decided={name: stats.decided for name, stats in proof.stats.items()},
        induction={
            "steps": steps.steps,
            "sound states": sum(steps.places.values()),
            "places": len(steps.places),
            "unsound states": steps.rejected,
            "laws": len(steps.applied),
        },
        limits=shipped_limits(),
    )


def shipped_limits() -> Dict[str, Dict[str, float]]:
    """Return of each limit its value where nobody says another one, and what it may be, times in seconds."""
    found = {}
    for each in fields(Limits):
        row: LimitRow = each.metadata["row"]
        scale = 1e9 if each.name.endswith("_ns") else 1.0
        found[each.name] = {"value": each.default / scale, "least": row.least, "most": row.most}
    return found


def _counted(stats: Stats) -> Dict[str, int]:
    return {
        "states": stats.states,
        "transitions": stats.transitions,
        "lies": stats.lies,
        "depth": stats.depth,
        "handed over": stats.stopped,
        "cut off": stats.cut,
    }


def differences(accepted: Optional[Figures], found: Figures, *parts: str) -> Tuple[str, ...]:
    """Return what changed, one line each; `parts` are the fields to compare: none means all."""
    if accepted is None:
        return ("nothing was accepted before",)
    lines: List[str] = []
    for each in fields(Figures):
        if each.name not in OF_NO_RUN and (not parts or each.name in parts):
            lines += _different(each.name, getattr(accepted, each.name), getattr(found, each.name))
    return tuple(lines)


def _different(name: str, old: Any, new: Any) -> Iterator[str]:
    if old == new:
        return
    if isinstance(new, int):
        yield f"{name}: {old} -> {new}"
    elif isinstance(new, tuple):
        yield from (f"{name}: {each} is no longer reached" for each in old if each not in new)
        yield from (f"{name}: {each} is reached now" for each in new if each not in old)
    else:
        yield from (f"{name}: {each} is gone" for each in old if each not in new)
        yield from (f"{name}: {each} is new: {_said(new[each])}" for each in new if each not in old)
        both = [each for each in new if each in old and old[each] != new[each]]
        yield from (f"{name}: {each}: {_change(old[each], new[each])}" for each in both)


def _said(value: Any) -> str:
    return ", ".join(f"{key} {each}" for key, each in value.items()) if isinstance(value, dict) else str(value)


def otherwise(accepted: Figures, world: str, stats: Stats) -> str:
    """Return the first figure in which a world differs from what it was accepted with; empty: in none.

    What it reaches counts first, then how many states and transitions there are, then what was decided in them.
    """
    pairs: Tuple[Tuple[Any, Any], ...] = (
        (accepted.reached.get(world, ""), stats.reached),
        (accepted.worlds.get(world, {}), _counted(stats)),
        (accepted.decided.get(world, {}), stats.decided),
    )
    return next((_change(old, new) for old, new in pairs if old != new), "")


def _change(old: Any, new: Any) -> str:
    if isinstance(new, str):
        before, now = old.split(AND), new.split(AND)
        words = [f"{each} is no longer reached" for each in before if each not in now]
        return ", ".join(words + [f"{each} is reached now" for each in now if each not in before])
    if isinstance(new, int):
        return f"{old} -> {new}" + (" times: it has fallen silent" if new == 0 else "")
    changed = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    return ", ".join(f"{key} {old.get(key)} -> {new.get(key)}" for key in changed)


def read(path: Path = ACCEPTED) -> Optional[Figures]:
    """Return figures from disk; None: there are none."""
    if not path.is_file():
        return None
    data = json.loads(path.read_text(encoding="ascii"))
    return Figures(**{name: tuple(value) if isinstance(value, list) else value for name, value in data.items()})


def write(figures: Figures, reason: str, path: Path = ACCEPTED) -> Figures:
    """Write figures with the reason why they are right; return them."""
    accepted = replace(figures, reason=reason)
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(asdict(accepted), indent=1) + "\n", encoding="ascii")
    return accepted


def keep(figures: Figures) -> None:
    """Keep the figures of this run, so that they can be accepted without another one."""
    write(figures, figures.reason, KEPT)


def kept() -> Optional[Figures]:
    """Return the figures of the last run, if nothing that they depend on has changed since."""
    last = read(KEPT)
    return last if last is not None and last.sources == fingerprint() else None


def fingerprint() -> str:
    """Return a digest of every file of this repository that the proof imports, and of the version of Python.

    The proof reads nothing else, no clock and no chance: of the same sources it has the same figures.
    """
    found = subprocess.run(
        [sys.executable, "-c", _LOADED],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        check=True,
        timeout=60,
        text=True,
    )
    names = {Path(line).resolve() for line in found.stdout.splitlines()}
    ours = sorted(
        path.relative_to(ROOT) for path in names if any(ROOT / each in path.parents for each in ("src", "test"))
    )
    if not any(path.name == "decide.py" for path in ours):
        raise RuntimeError("what the proof imports is not of this repository: install it (./run build)")
    digest = hashlib.sha256(sys.version.split()[0].rpartition(".")[0].encode())
    for path in ours:
        digest.update(str(path).encode() + (ROOT / path).read_bytes())
    return digest.hexdigest()


def by_day(worlds: Sequence[str], accepted: Optional[Figures], count: int) -> Tuple[str, ...]:
    """Return the worlds that a commit explores anew: all, or so many where the figures are those of these very sources.

    Which ones is drawn by the commit.
    """
    if accepted is None or accepted.sources != fingerprint():
        return tuple(worlds)
    commit = subprocess.run(
        ["git", "rev-parse", "HEAD"],
        cwd=str(ROOT),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        check=False,  # in an archive without its history
        timeout=60,
    )
    return tuple(random.Random(commit.stdout or accepted.sources).sample(list(worlds), count))
