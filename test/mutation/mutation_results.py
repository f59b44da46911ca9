"""What a campaign found: results.json, and its part of docs/safety.md; the waivers of mutants that change nothing."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import yaml
from mutation_mutant import EXPLORER, MUTATED, NETS, SAME_BY_NATURE, UNIT, Mutant, Place

HERE = Path(__file__).parent
RESULTS, WAIVERS = HERE / "results.json", HERE / "waivers.yaml"
PAGE = HERE.parents[1] / "docs" / "safety.md"
HEAD, FOLLOWING = "## Would anybody notice a mistake?", "## What is assumed"
"""Of the part of the page about the campaign, and of the one behind it: `test/proof` writes the page."""
_LIMIT_ROW = re.compile(r"= _[A-Z]+\.(?:time|number)\(")
"""In `engine/rules.py`: what a limit is where nobody says, and what it may be; every world has limits of its own."""
_REACHED, _FIGURES = " reached", " -> "
"""In what the explorer says: no law is broken, but something else is reached, or there are other figures."""


class Verdict(NamedTuple):
    """A mutant, and of each net that it was shown to: what caught it; empty: nothing did."""

    mutant: Mutant
    caught_by: Mapping[str, str]
    waived: str

    @property
    def survived(self) -> bool:
        """Tell whether no net has caught it."""
        return not any(self.caught_by.values())


class Waiver(NamedTuple):
    """A mutant that behaves as the original does, and why."""

    path: str
    before: str
    after: str
    reason: str


class Results(NamedTuple):
    """A campaign: what was drawn from how many, and what came of it."""

    seed: int
    places: int
    observed: Mapping[str, Sequence[str]]
    """Of each net the files that it runs at all."""
    verdicts: Sequence[Verdict]
    code: Mapping[str, str] = {}
    """Of which code, a digest for each file: of another one nothing counts."""
    tests: Mapping[str, str] = {}
    """Of which tests, a digest for each net: others may catch what survived these."""

    @property
    def survivors(self) -> List[Verdict]:
        """Return what no net caught and nobody waived."""
        return [one for one in self.verdicts if one.survived and not one.waived]

    @property
    def not_needed(self) -> List[Verdict]:
        """Return what is waived and was caught."""
        return [one for one in self.verdicts if one.waived and not one.survived]


def waivers(path: Path = WAIVERS) -> Dict[Tuple[str, str, str], Waiver]:
    """Return the waivers by path, line before, line after.

    Raises:
        ValueError: one has no reason.
    """
    found = [Waiver(**one) for one in yaml.safe_load(path.read_text(encoding="utf-8"))["waivers"]]
    for one in found:
        if not one.reason.strip():
            raise ValueError(f"{one.path}: {one.before}: a waiver needs a reason")
    return {one[:3]: one for one in found}


def results(campaign: Any, mutants: Sequence[Mutant], places: int, seed: int, nets: Sequence[str]) -> Results:
    """Return what is known of a sample."""
    waived = waivers()
    verdicts = []
    for mutant in mutants:
        caught_by = {net: campaign.known[mutant.key, net] for net in nets if (mutant.key, net) in campaign.known}
        waiver = waived.get((mutant.place.path, mutant.before, mutant.after))
        verdicts.append(Verdict(mutant, caught_by, waiver.reason if waiver is not None else ""))
    return Results(seed, places, campaign.files(nets), verdicts, campaign.code, campaign.tests)


def write(told: Results, path: Path, page: Path = PAGE) -> None:
    """Keep a campaign, and show it on the page."""
    rows = [
        {
            **one.mutant.place._asdict(),
            "before": one.mutant.before,
            "after": one.mutant.after,
            "caught_by": dict(one.caught_by),
            "waived": one.waived,
        }
        for one in told.verdicts
    ]
    body = ",\n".join(json.dumps(row) for row in rows)
    head = json.dumps({name: value for name, value in told._asdict().items() if name != "verdicts"})
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'{{"campaign": {head}, "mutants": [\n{body}\n]}}\n', encoding="utf-8")
    text = page.read_text(encoding="utf-8")
    if HEAD not in text:
        begin, following, end = text.partition(FOLLOWING)
        text = f"{begin.rstrip()}\n\n{HEAD}\n\n{following}{end}"
    around = re.compile(f"{re.escape(HEAD)}\n.*?(?=^## |\\Z)", re.DOTALL | re.MULTILINE)
    page.write_text(around.sub(lambda _: f"{section(told)}\n", text), encoding="utf-8")


def read(path: Optional[Path] = None) -> Results:
    """Return the campaign that is kept."""
    path = RESULTS if path is None else path
    kept = json.loads(path.read_text(encoding="utf-8"))
    verdicts = [
        Verdict(
            Mutant(Place(**{name: row[name] for name in Place._fields}), row["before"], row["after"]),
            row["caught_by"],
            row["waived"],
        )
        for row in kept["mutants"]
    ]
    return Results(**kept["campaign"], verdicts=verdicts)


def rate(verdicts: Sequence[Verdict], nets: Sequence[str]) -> Tuple[int, int]:
    """Return how many were caught by one of some nets, of how many that were shown to one and are not waived."""
    shown = [one for one in verdicts if not one.waived and any(net in one.caught_by for net in nets)]
    return sum(any(one.caught_by.get(net) for net in nets) for one in shown), len(shown)


def figures(told: Results) -> List[Tuple[str, str, str]]:
    """Return the table: a net, what it was shown, what it caught."""
    rows = []
    for net in NETS:
        rows.append((net, "all", _share(*rate(told.verdicts, [net]))))
        if net in told.observed and net != UNIT:
            ran = [one for one in told.verdicts if one.mutant.place.path in told.observed[net]]
            rows.append((net, "in files that it runs", _share(*rate(ran, [net]))))
            if net == EXPLORER:
                moved = [one for one in ran if not _LIMIT_ROW.search(one.mutant.before)]
                rows.append((net, "in files that it runs, but for the rows of limits", _share(*rate(moved, [net]))))
                caught = [one.caught_by.get(net, "") for one in ran if not one.waived]
                for words, without in (("and by what it reaches", [_FIGURES]), ("alone", [_FIGURES, _REACHED])):
                    by_law = sum(bool(by) and not any(mark in by for mark in without) for by in caught)
                    rows.append((net, f"in files that it runs, by laws {words}", _share(by_law, rate(ran, [net])[1])))
    return [*rows, ("together", "all", _share(*rate(told.verdicts, NETS)))]


def _share(caught: int, shown: int) -> str:
    return f"{caught} of {shown} ({100 * caught / shown:.1f} %)" if shown else "none were shown"


def summary(told: Results, root: Path) -> str:
    """Return what is printed at the end: figures, survivors with their patches, waivers that are not needed."""
    from mutation_code import diff  # noqa: PLC0415 - cosmic-ray: the page does without

    lines = ["", *(f"{net:10} {shown:22} {caught}" for net, shown, caught in figures(told))]
    for one in told.survivors:
        source = (root / one.mutant.place.path).read_text(encoding="utf-8")
        lines += ["", f"SURVIVED, {one.mutant.place.operator}:", diff(source, one.mutant.place)]
    lines += [f"waiver not needed, caught: {one.mutant.before} -> {one.mutant.after}" for one in told.not_needed]
    seen = {(one.mutant.place.path, one.mutant.before, one.mutant.after) for one in told.verdicts}
    for path, before, after in waivers():
        if (path, before, after) not in seen and before not in _lines(root / path):
            lines.append(f"waiver not needed, {path} has no such line any more: {before} -> {after}")
    return "\n".join(lines)


def _lines(path: Path) -> str:
    return " ".join(line.strip() for line in path.read_text(encoding="utf-8").splitlines()) if path.exists() else ""


def shown() -> str:
    """Return the part of docs/safety.md about the campaign that is kept; empty: none is."""
    return section(read()) if RESULTS.is_file() else ""


def section(told: Results) -> str:
    """Return the part of docs/safety.md about the campaign."""
    waived = [one for one in told.verdicts if one.waived]
    parts = [
        f"{HEAD}\n",
        _WORDS.format(
            count=len(told.verdicts), places=told.places, seed=told.seed, same=len(SAME_BY_NATURE), where=_where()
        ),
        _table(("Net", "Of the mutants", "Caught"), figures(told)),
        f"Survivors, caught by no net: {len(told.survivors)}.\n",
    ]
    if told.survivors:
        parts.append(_table(_COLUMNS[:3], [_row(one) for one in told.survivors]))
    parts.append(f"Waived, because they behave as the original does: {len(waived)}.\n")
    if waived:
        parts.append(_table(_COLUMNS, [(*_row(one), one.waived) for one in waived]))
    return "\n".join(parts)


_COLUMNS = ("Where", "Line", "Mutated", "Why it changes nothing")
_WORDS = """\
The defects that the proof proves itself with were picked by those who wrote it: that all of them are caught says
little. Of 40 that others wrote, when all 87 of its own were caught, the explorer caught 13, of those 35 that unit
tests could see these caught 25, of 12 that scenarios could see 5. So nobody picks here: cosmic-ray changes one place
of {where}, a comparison, a number, a condition, an operator, a decorator, a loop, an `except`. Of {places} such
changes {count} are drawn by the seed {seed}, places first. {same} operators are left out: `is` for `==` and the like
change nothing where values are enumerations.

<!-- not run: hours -->

```
./run mutate engine                             # 400 mutants, all nets; goes on where it was ended
./run mutate engine --sample 1000 --seed 2      # others
./run mutate engine --nets unit                 # one net: explorer, unit, scenarios
```

A mutant is shown to those worlds, tests and scenarios that run its statement. The explorer is `test/proof`: every world
up to the bound of the proof, its laws, that time does not go round, that it reaches what it was accepted with (rows,
places, failures and laws), and that its figures are those that were accepted: how many states and transitions there
are, how many commands of each kind, a digest of what stands in them, and the limits that ship. The table says what laws
alone catch, and what is caught without the figures: they say that something is different, laws say what is wrong. It
does not run the monitors, nor what writes journals and documents: its share in the files that it runs is the figure
that says how good it is. Beside it stands that without the rows of limits: every world has limits of its own, so that
those that ship, and what they may be, are caught as figures alone. Unit tests are `test/engine` and `test/monitoring`,
scenarios are `test/scenarios`. A mutant that never ends is caught.
"""


def _where() -> str:
    folders = [f"`{Path(folder).name}/`" for folder in MUTATED]
    return f"{', '.join(folders[:-1])} or {folders[-1]}"


def _row(one: Verdict) -> Tuple[str, str, str]:
    place = one.mutant.place
    where = f"{'/'.join(Path(place.path).parts[-2:])}:{place.line}"
    return where, f"`{_cell(one.mutant.before)}`", f"`{_cell(one.mutant.after) or '(left out)'}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"
