"""What is mutated: every change that cosmic-ray's operators know in the engine and the monitors, and a sample of them.

cosmic-ray finds the places and writes the mutated source; nobody picks. Its own runner is not used: it mutates files in
place and knows one command, where three nets are told apart here (`mutation_nets`). It runs on Python 3.8 and on newer
ones, where mutmut 3 needs Python 3.9 and leaves out what stands in tables at the top of a module.
"""

from __future__ import annotations

import ast
import difflib
import hashlib
from pathlib import Path
from typing import Dict, Iterable, Iterator, List, Tuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names
from mutation_mutant import MUTATED, SAME_BY_NATURE, Mutant, Place


def places(root: Path) -> List[Place]:
    """Return what can be changed in the engine and the monitors, in the order of files and operators."""
    found: List[Place] = []
    for folder in MUTATED:
        for path in sorted((root / folder).rglob("*.py")):
            found += of_source(path.read_text(encoding="utf-8"), path.relative_to(root).as_posix())
    return found


def of_source(source: str, path: str) -> Iterator[Place]:
    """Yield what can be changed in a file's text."""
    nodes = tuple(ast_nodes(get_ast(source)))
    for name in sorted(operator_names()):
        operator_class = get_operator(name)
        if operator_class.arguments() or name in SAME_BY_NATURE:
            continue  # those with arguments need variables that somebody picks
        operator = operator_class()
        starts = (start for node in nodes for start, _ in operator.mutation_positions(node))
        for occurrence, (line, column) in enumerate(starts):
            yield Place(path, line, column, name, occurrence)


def changed_lines(source: str, changed: str) -> Tuple[str, str]:
    """Return the lines that differ, before and after, without indentation."""
    old, new = source.splitlines(), changed.splitlines()
    begin = next((n for n, (one, other) in enumerate(zip(old, new)) if one != other), min(len(old), len(new)))
    end = 0
    while end < min(len(old), len(new)) - begin and old[-1 - end] == new[-1 - end]:
        end += 1
    cut = [" ".join(line.strip() for line in lines[begin : len(lines) - end]) for lines in (old, new)]
    return cut[0], cut[1]


def sample(found: Iterable[Place], count: int, seed: int, root: Path) -> List[Mutant]:
    """Return so many mutants, drawn by a seed: where first, then by which operator, so that a comparison, which has
    seven, counts no more than others. A larger sample of the same seed begins with the smaller one, and a change of the
    code draws anew what it touches alone: the order is that of digests of the lines.
    """
    texts: Dict[str, str] = {}
    drawn: Dict[str, Mutant] = {}
    for place in _in_order(found, seed, root, texts):
        source = texts[place.path]
        mutant = Mutant(place, *changed_lines(source, mutated(source, place)))
        if mutant.before != mutant.after:
            drawn.setdefault(mutant.key, mutant)
        if len(drawn) == count:
            break
    return list(drawn.values())


def _in_order(found: Iterable[Place], seed: int, root: Path, texts: Dict[str, str]) -> List[Place]:
    """Return places by the digests of where they are, with one operator of each first; keep the files' texts."""
    there: Dict[Tuple[str, int, int], List[Place]] = {}
    for place in found:
        there.setdefault(place[:3], []).append(place)
    lines: Dict[str, List[str]] = {}
    for path in {place[0] for place in there}:
        texts[path] = (root / path).read_text(encoding="utf-8")
        lines[path] = texts[path].splitlines()
    ranked: List[Tuple[int, str, Place]] = []
    for (path, line, column), operators in there.items():
        text = lines[path][line - 1]
        same = lines[path][: line - 1].count(text)
        name = f"{seed}\n{path}\n{same}\n{text.strip()}\n{column - len(text) + len(text.lstrip())}"
        operators.sort(key=lambda place: _digest(f"{name}\n{place.operator}"))
        ranked += ((number, _digest(name), place) for number, place in enumerate(operators))
    return [place for _, _, place in sorted(ranked)]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def mutated(source: str, place: Place) -> str:
    """Return the file's text, changed."""
    changed: str = mutate_code(source, get_operator(place.operator)(), place.occurrence)
    return changed


def diff(source: str, place: Place) -> str:
    """Return what the change does, as a patch."""
    lines = source.splitlines(), mutated(source, place).splitlines()
    return "\n".join(difflib.unified_diff(*lines, place.path, place.path, lineterm="", n=1))


def span(source: str, line: int) -> Tuple[int, int]:
    """Return first and last line of the statement in a function that a line belongs to; of `if` and the like the head.

    (0, 0): it is done when the module is loaded, as are decorators and defaults.
    """
    around = (0, 0)
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, (ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        for node in (each for statement in function.body for each in ast.walk(statement)):
            if isinstance(node, ast.stmt):
                end = node.body[0].lineno - 1 if hasattr(node, "body") else node.end_lineno or node.lineno
                if node.lineno <= line <= max(end, node.lineno) and node.lineno >= around[0]:
                    around = node.lineno, max(end, node.lineno)
    return around
