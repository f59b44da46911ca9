"""What is mutated: every change that cosmic-ray's operators know in the engine and the monitors, and a sample of them.

cosmic-ray finds the places and writes the mutated source; nobody picks. Its own runner is not used: it mutates files in
place and knows one command, where three nets are told apart here (`mutation_nets`). It runs on Python 3.8 and on newer
ones, where mutmut 3 needs Python 3.9 and leaves out what stands in tables at the top of a module.
"""

from __future__ import annotations

import ast
import difflib
import random
from pathlib import Path
from typing import Dict, Iterable, Iterator, List, Tuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names
from mutation_mutant import MUTATED, SAME_BY_NATURE, Mutant, Place

__all__ = ["diff", "mutated", "of_source", "places", "sample", "span"]


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
    seven, counts no more than others. A larger sample of the same seed begins with the smaller one.
    """
    there: Dict[Tuple[str, int, int], List[Place]] = {}
    for place in found:
        there.setdefault(place[:3], []).append(place)
    draw = random.Random(seed)
    rounds = list(there.values())
    drawn: Dict[str, Mutant] = {}
    while rounds and len(drawn) < count:
        draw.shuffle(rounds)
        for of_place in rounds:
            place = of_place.pop(draw.randrange(len(of_place)))
            source = (root / place.path).read_text(encoding="utf-8")
            mutant = Mutant(place, *changed_lines(source, mutated(source, place)))
            if mutant.before != mutant.after:
                drawn.setdefault(mutant.key, mutant)
            if len(drawn) == count:
                break
        rounds = [of_place for of_place in rounds if of_place]
    return list(drawn.values())


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
