"""Part of `./run lint`: tests that cannot fail, or never end, found in the source; each with file and line, and 1 if
there are any.

What it finds:

* an assertion that is always true: `or True`, a constant, a filled tuple, something compared with itself;
* a test that asserts nothing on any way: no `assert`, `pytest.raises` or `self.assert...`, and no call of a helper of
  ours, method or fixture that does; what stands behind a `return` or in `if False` does not count;
* `pytest.raises(Exception)` without `match`: a name that is written wrongly is an exception as well;
* a test whose every assertion is in a loop, or in `all(...)`, over something that may be empty, as far as that can be
  seen: what is written out, counted from constants, or asserted not to be empty is not;
* `assert tested() or case == 1`, where the second side is fixed by the case (a parameter of `parametrize`, what a loop
  over constants goes through, and what is taken from them): for this case it says nothing. What hypothesis draws is
  no case: there are many;
* a test that has an assertion for some of its cases only, the others being returned from or not in any branch;
* an assertion in a test whose failure is caught: `suppress(AssertionError)`, `except Exception: pass`;
* a wait without a limit, in tests and helpers: `.wait()`, `.join()`, `.get()` and others without an argument, a
  program or a connection without `timeout`, a loop that only sleeps and looks at no clock. What was killed before, in
  the same block, ends; a method of ours is looked at where it is.

A test that is meant so says why on its line: `# hollow: REASON`.
"""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from typing import Dict, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple, Union

TEST = Path(__file__).resolve().parents[1]
_MEANT = re.compile(r"# hollow: \S")
_ENDS = (ast.Return, ast.Raise, ast.Continue, ast.Break)
_RAISES = {"raises", "warns", "deprecated_call", "fail", "xfail"}
_CATCH_ALL = {"Exception", "BaseException"}
_PURE = {"abs", "bool", "float", "int", "len", "list", "max", "min", "repr", "round", "set", "sorted", "str", "tuple"}
_TAKES = {
    *("endswith", "format", "get", "items", "keys", "lower", "lstrip", "partition", "replace", "rpartition", "rstrip"),
    *("split", "startswith", "strip", "upper", "values"),
}
_SAME_LENGTH = {"enumerate", "sorted", "reversed", "list", "tuple", "set", "dict"}
_ALL_OF = {"zip", "product"}
_MUTABLE = (ast.List, ast.Dict, ast.Set, ast.ListComp, ast.DictComp, ast.SetComp)
_CLASS = re.compile(r"[A-Z][A-Za-z0-9]*[a-z][A-Za-z0-9]*$")  # an enumeration: it has members
_CONSTANT = re.compile(r"[A-Z][A-Z0-9_]*$")
_WAITS = {"acquire", "communicate", "get", "join", "result", "wait"}  # of what comes when it comes
_PROGRAMS = {"call", "check_call", "check_output", "run"}  # of subprocess
_LIMIT_AT = {"create_connection": 1, "urlopen": 2}  # the place of their limit
_CLOCKS = {"monotonic", "monotonic_ns", "now", "perf_counter", "perf_counter_ns", "time", "time_ns"}
Function = Union[ast.FunctionDef, ast.AsyncFunctionDef]


class Hollow(NamedTuple):
    """A test that cannot fail, or may not end: where, and why."""

    path: Path
    line: int
    why: str


class Module:
    """One file of the tests: its functions by name, methods included, and where its names come from."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = path.read_text(encoding="utf-8")
        self.lines = self.text.splitlines()
        self.tree = ast.parse(self.text)
        self.functions: Dict[str, List[Function]] = {}
        self.classes: Dict[str, List[Function]] = {}
        self.imports: Set[str] = set()
        self.imported: Set[str] = set()
        for node in ast.walk(self.tree):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                self.functions.setdefault(node.name, []).append(node)
            elif isinstance(node, ast.ClassDef):
                self.classes[node.name] = [each for each in node.body if isinstance(each, ast.FunctionDef)]
            elif isinstance(node, ast.ImportFrom):
                self.imports.add((node.module or "").rpartition(".")[2])
            elif isinstance(node, ast.Import):
                self.imports.update(alias.name.rpartition(".")[2] for alias in node.names)
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                self.imported.update((alias.asname or alias.name).split(".")[0] for alias in node.names)
        self.constants = dict(_assigned(self.tree.body))
        self.seen: List[Module] = []  # see `_seen_by`

    def meant(self, line: int) -> bool:
        """Tell whether a line says why it is so."""
        return bool(_MEANT.search(self.lines[line - 1]))


def _assigned(body: Sequence[ast.stmt]) -> Iterator[Tuple[str, ast.expr]]:
    """Yield what names are given, in some statements."""
    for statement in body:
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            yield statement.targets[0].id, statement.value
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name) and statement.value:
            yield statement.target.id, statement.value


def hollow_tests(paths: Iterable[Path]) -> List[Hollow]:
    """Return what cannot fail, or may not end, in some files of tests, helpers among them."""
    modules = [Module(path) for path in sorted(paths)]
    asserting = _asserting(modules)
    found: List[Hollow] = []
    for module in modules:
        found += [Hollow(module.path, line, why) for line, why in _of_module(module, modules, asserting)]
    return [each for each in found if not _at(each, modules).meant(each.line)]


def _at(each: Hollow, modules: Sequence[Module]) -> Module:
    return next(module for module in modules if module.path == each.path)


def _of_module(module: Module, modules: Sequence[Module], asserting: Set[int]) -> Iterator[Tuple[int, str]]:
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Assert) and _always_true(node.test):
            yield node.lineno, "this is always true"
        if isinstance(node, ast.Call) and _raises_anything(node):
            yield node.lineno, "any exception will do, even of a name that is written wrongly: name it, or give a match"
    for line in _endless(module.tree, _limited(module, modules)):
        yield line, "this may wait for ever, and all tests after it: give it a limit"
    known = _callable_names(module, modules, asserting)
    for functions in module.functions.values():
        for test in functions:
            if test.name.startswith("test_") and not _is_fixture(test):
                yield from _of_test(test, module, modules, asserting, known)


def _of_test(
    test: Function, module: Module, modules: Sequence[Module], asserting: Set[int], known: Set[str]
) -> Iterator[Tuple[int, str]]:
    fixed = _fixed_names(test, module, modules)
    for node in ast.walk(test):
        if isinstance(node, ast.Assert) and _sometimes_true(node.test, fixed):
            yield node.lineno, "for some of its cases this says nothing: give each what is expected of it"
        if isinstance(node, (ast.With, ast.Try)) and _swallows(node):
            yield node.lineno, "an assertion that fails in here is swallowed"
    if _fixtures_assert(test, module, modules, asserting, known):
        return
    if id(test) not in asserting:
        yield test.lineno, f"{test.name} asserts nothing"
    elif _only_in_loops(test, module, modules, known):
        yield test.lineno, f"{test.name} asserts nothing when what it goes through is empty"
    elif not _for_each_case(test.body, fixed, known):
        yield test.lineno, f"{test.name} asserts nothing for some of its cases"


# --- assertions that are always true ----------------------------------------------------------------------------------


def _always_true(node: ast.expr) -> bool:
    if isinstance(node, ast.BoolOp):
        operands = map(_always_true, node.values)
        return any(operands) if isinstance(node.op, ast.Or) else all(operands)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return isinstance(node.operand, ast.Constant) and not node.operand.value
    if isinstance(node, ast.Compare):
        same = ast.dump(node.left) == ast.dump(node.comparators[0]) and not _calls(node)
        return len(node.ops) == 1 and same and isinstance(node.ops[0], (ast.Eq, ast.Is, ast.LtE, ast.GtE))
    return _filled(node) or isinstance(node, ast.Lambda)


def _filled(node: ast.expr) -> bool:
    """Tell whether something written out is true."""
    if isinstance(node, ast.Constant):
        return bool(node.value)
    if isinstance(node, (ast.Tuple, ast.List, ast.Set)):
        return any(not isinstance(each, ast.Starred) for each in node.elts)
    if isinstance(node, ast.Dict):
        return any(key is not None for key in node.keys)
    return False


def _calls(node: ast.AST) -> List[ast.Call]:
    return [each for each in ast.walk(node) if isinstance(each, ast.Call)]


def _raises_anything(call: ast.Call) -> bool:
    named = isinstance(call.func, ast.Attribute) and call.func.attr in {"raises", "assertRaises"}
    given = [*call.args[:1], *(each.value for each in call.keywords if each.arg == "expected_exception")]
    matched = any(keyword.arg == "match" for keyword in call.keywords)
    return named and not matched and any(_kinds(each) & _CATCH_ALL for each in given)


def _kinds(node: Optional[ast.expr]) -> Set[str]:
    """Return the names of the exceptions that are named; a bare `except` names all."""
    if node is None:
        return set(_CATCH_ALL)
    if isinstance(node, ast.Tuple):
        return {name for each in node.elts for name in _kinds(each)}
    return {node.attr} if isinstance(node, ast.Attribute) else {node.id} if isinstance(node, ast.Name) else set()


# --- assertions whose failure is caught -------------------------------------------------------------------------------


def _swallows(node: Union[ast.With, ast.Try]) -> bool:
    asserts = any(isinstance(inner, ast.Assert) for each in node.body for inner in ast.walk(each))
    if isinstance(node, ast.With):
        return asserts and any(_suppresses(item.context_expr) for item in node.items)
    return asserts and any(_catches(each) and not _passes_on(each) for each in node.handlers)


def _suppresses(node: ast.expr) -> bool:
    if not isinstance(node, ast.Call) or _kinds(node.func) != {"suppress"}:
        return False
    return any(_kinds(each) & {"AssertionError", *_CATCH_ALL} for each in node.args)


def _catches(handler: ast.ExceptHandler) -> bool:
    return bool(_kinds(handler.type) & {"AssertionError", *_CATCH_ALL})


def _passes_on(handler: ast.ExceptHandler) -> bool:
    return any(isinstance(inner, ast.Raise) or _asserts(inner) for each in handler.body for inner in ast.walk(each))


# --- waits without a limit --------------------------------------------------------------------------------------------
# A wait for what never comes is no failure: nothing is said of any test, until somebody looks.


def _endless(tree: ast.AST, ours: Set[str]) -> Iterator[int]:
    """Yield the lines of what waits without a limit."""
    loops = (node for node in ast.walk(tree) if isinstance(node, ast.While))
    yield from (loop.lineno for loop in loops if _only_sleeps(loop))
    waits = [call for call in _calls(tree) if _unlimited(call, ours)]
    ended = _ended(tree) if waits else set()
    yield from (call.lineno for call in waits if id(call) not in ended)


def _unlimited(call: ast.Call, ours: Set[str]) -> bool:
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    given = {each.arg for each in call.keywords}
    limited = bool(given & {"timeout", None})  # None: of `**more`, which may have one
    if name in _LIMIT_AT:
        return not limited and len(call.args) <= _LIMIT_AT[name]
    if not isinstance(call.func, ast.Attribute):
        return False
    if _kinds(call.func.value) == {"subprocess"}:
        return not limited and name in _PROGRAMS
    return name in _WAITS - ours and not call.args and not given


def _only_sleeps(loop: ast.While) -> bool:
    """Tell whether a loop does nothing but sleep until something is so, whatever the time is."""
    sleeps = all(isinstance(each, ast.Expr) and _called(each.value) & {"sleep", "wait"} for each in loop.body)
    return sleeps and not any(_called(call) & _CLOCKS for call in _calls(loop.test))


def _limited(module: Module, modules: Sequence[Module]) -> Set[str]:
    """Return the names of the waits that are methods of ours, need no argument, and have a limit inside."""
    named = [
        (name, each) for seen in _seen_by(module, modules) for name in _WAITS for each in seen.functions.get(name, ())
    ]
    return {name for name, each in named if _needs_nothing(each) and not any(_endless(each, set()))}


def _needs_nothing(function: Function) -> bool:
    given = function.args
    needed = {each.arg for each in given.args[: len(given.args) - len(given.defaults)]} - {"self", "cls"}
    return not needed and None not in given.kw_defaults


def _ended(tree: ast.AST) -> Set[int]:
    """Return the waits, by identity, for what was killed before, in the same block."""
    ended: Set[int] = set()
    for node in ast.walk(tree):
        for _, body in ast.iter_fields(node):
            for number, statement in enumerate(body if isinstance(body, list) else ()):
                killed = _killed(statement)
                later = [call for each in body[number + 1 :] for call in _calls(each)] if killed else ()
                ended |= {id(call) for call in later if killed == _waited_for(call)}
    return ended


def _killed(statement: ast.AST) -> Optional[str]:
    """Return what a statement kills."""
    call = statement.value if isinstance(statement, ast.Expr) else None
    if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Attribute):
        return None
    name, first = call.func.attr, call.args[0] if call.args else None
    if name == "kill" and first is None:
        return ast.dump(call.func.value)
    if "SIGKILL" not in ast.dump(call):
        return None
    if name in {"kill", "killpg"} and isinstance(first, ast.Attribute) and first.attr == "pid":
        return ast.dump(first.value)
    return ast.dump(call.func.value) if name == "send_signal" else None


def _waited_for(call: ast.Call) -> Optional[str]:
    return ast.dump(call.func.value) if isinstance(call.func, ast.Attribute) and call.func.attr == "wait" else None


# --- tests that assert nothing ----------------------------------------------------------------------------------------


def _asserting(modules: Sequence[Module]) -> Set[int]:
    """Return the functions, by identity, that assert something, by themselves or by those that they call."""
    found = {
        id(function)
        for module in modules
        for functions in module.functions.values()
        for function in functions
        if any(_asserts(node) for node in _reachable(function.body))
    }
    before = -1
    while before != len(found):
        before = len(found)
        for module in modules:
            known = _callable_names(module, modules, found)
            for functions in module.functions.values():
                for function in functions:
                    if id(function) not in found and any(_called(node) & known for node in _reachable(function.body)):
                        found.add(id(function))
    return found


def _asserts(node: ast.AST) -> bool:
    if isinstance(node, ast.Assert):
        return not _always_true(node.test)
    if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
        return "AssertionError" in ast.dump(node.exc.func) or "Failure" in ast.dump(node.exc.func)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        ours = isinstance(node.func.value, ast.Name) and node.func.value.id in {"self", "pytest", "test", "case"}
        return ours and (node.func.attr in _RAISES or node.func.attr.startswith("assert"))
    return False


def _called(node: ast.AST) -> Set[str]:
    """Return the name that is called, or handed over to be called."""
    if not isinstance(node, ast.Call):
        return set()
    given = {each.id for each in [*node.args, *(k.value for k in node.keywords)] if isinstance(each, ast.Name)}
    given |= {each.attr for each in node.args if isinstance(each, ast.Attribute)}
    if isinstance(node.func, ast.Attribute):
        return given | {node.func.attr}
    return given | {node.func.id} if isinstance(node.func, ast.Name) else given


def _seen_by(module: Module, modules: Sequence[Module]) -> List[Module]:
    """Return the modules whose functions and methods a module may call: itself, what it imports, its conftests."""
    if not module.seen:
        module.seen = _looked_up(module, modules)
    return module.seen


def _looked_up(module: Module, modules: Sequence[Module]) -> List[Module]:
    seen, new = {module.path: module}, [module]
    while new:
        names = {name for each in new for name in each.imports}
        folders = {parent for each in new for parent in each.path.parents}
        new = [
            each
            for each in modules
            if each.path not in seen
            and (each.path.stem in names or (each.path.stem == "conftest" and each.path.parent in folders))
        ]
        seen.update({each.path: each for each in new})
    return list(seen.values())


def _callable_names(module: Module, modules: Sequence[Module], asserting: Set[int]) -> Set[str]:
    names = set()
    for each in _seen_by(module, modules):
        names |= {name for name, functions in each.functions.items() if any(id(one) in asserting for one in functions)}
        for name, methods in each.classes.items():
            if any(id(one) in asserting and one.name in {"__init__", "__enter__", "__exit__"} for one in methods):
                names.add(name)
    return names - {"main", "run", "__init__", "close", "get", "add"}


def _reachable(body: Sequence[ast.stmt]) -> Iterator[ast.AST]:
    """Yield all nodes but those behind a return, in `if False`, or in a function of its own that nobody calls."""
    for statement in body:
        if isinstance(statement, (ast.If, ast.While)) and _never(statement.test):
            yield from _reachable(statement.orelse)
            continue
        yield statement
        inner = [value for _, value in ast.iter_fields(statement)]
        for value in inner:
            if isinstance(value, list) and value and isinstance(value[0], ast.stmt):
                yield from _reachable(value)
            else:
                for each in value if isinstance(value, list) else [value]:
                    if isinstance(each, ast.ExceptHandler):
                        yield from _reachable(each.body)
                    elif isinstance(each, ast.AST):
                        yield from ast.walk(each)
        if isinstance(statement, _ENDS):
            return


def _never(test: ast.expr) -> bool:
    return isinstance(test, ast.Constant) and not test.value


def _is_fixture(function: Function) -> bool:
    return any("fixture" in ast.dump(decorator) for decorator in function.decorator_list)


def _fixtures_assert(
    test: Function, module: Module, modules: Sequence[Module], asserting: Set[int], known: Set[str]
) -> bool:
    names = {each.arg for each in test.args.args} & known
    fixtures = [f for each in _seen_by(module, modules) for name in names for f in each.functions.get(name, ())]
    return any(_is_fixture(each) and id(each) in asserting for each in fixtures)


# --- assertions that are never come to --------------------------------------------------------------------------------


def _only_in_loops(test: Function, module: Module, modules: Sequence[Module], known: Set[str]) -> bool:
    """Tell whether every assertion of a test is in a loop over what may be empty; what hypothesis draws seldom is."""
    if any("given" in ast.dump(decorator) for decorator in test.decorator_list):
        return False
    given = [*_assigned(test.body), *(each for seen in _seen_by(module, modules) for each in seen.constants.items())]
    filled = {name for name, value in given if _cannot_be_empty(value, set())}
    return not any(_certain(node, known, filled) for node in _outside(test.body, filled))


def _outside(body: Sequence[ast.stmt], filled: Set[str]) -> Iterator[ast.AST]:
    """Yield what is done for certain: all but the bodies of loops that may not be entered."""
    for statement in body:
        if isinstance(statement, (ast.For, ast.AsyncFor)) and not _cannot_be_empty(statement.iter, filled):
            yield from ast.walk(statement.iter)
            yield from _outside(statement.orelse, filled)
            continue
        yield statement
        for _, value in ast.iter_fields(statement):
            if isinstance(value, list) and value and isinstance(value[0], ast.stmt):
                yield from _outside(value, filled)
            else:
                for each in value if isinstance(value, list) else [value]:
                    if isinstance(each, ast.ExceptHandler):
                        yield from _outside(each.body, filled)
                    elif isinstance(each, ast.AST):
                        yield from ast.walk(each)


def _certain(node: ast.AST, known: Set[str], filled: Set[str]) -> bool:
    if isinstance(node, ast.Assert):
        return not _vacuous(node.test, filled)
    return _asserts(node) or bool(_called(node) & known)


def _vacuous(test: ast.expr, filled: Set[str]) -> bool:
    """Tell whether it is `all(...)` over what may be empty."""
    if not (isinstance(test, ast.Call) and isinstance(test.func, ast.Name) and test.func.id == "all" and test.args):
        return False
    over = test.args[0]
    if isinstance(over, (ast.GeneratorExp, ast.ListComp)):
        return any(each.ifs or not _cannot_be_empty(each.iter, filled) for each in over.generators)
    return not _cannot_be_empty(over, filled)


def _cannot_be_empty(node: ast.expr, filled: Set[str]) -> bool:
    if isinstance(node, ast.Name):
        return node.id in filled or bool(_CLASS.match(node.id))
    if _filled(node):
        return True
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        return node.func.attr in {"items", "keys", "values"} and _cannot_be_empty(node.func.value, filled)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        if node.func.id == "range":
            return _counts(node.args)
        if node.func.id in _SAME_LENGTH:
            return bool(node.args) and _cannot_be_empty(node.args[0], filled)
        return node.func.id in _ALL_OF and all(_cannot_be_empty(each, filled) for each in node.args)
    if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Add, ast.Mult)):
        return _cannot_be_empty(node.left, filled) or _cannot_be_empty(node.right, filled)
    if isinstance(node, (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)):
        return all(not each.ifs and _cannot_be_empty(each.iter, filled) for each in node.generators)
    return False


def _counts(arguments: Sequence[ast.expr]) -> bool:
    """Tell whether a range of constants has something in it."""
    numbers = [_number(each) for each in arguments]
    if len(numbers) == 1:
        return numbers[0] is None or numbers[0] > 0  # a name that is counted to is not taken for none
    return None in numbers or bool(range(*[number for number in numbers if number is not None]))


def _number(node: ast.expr) -> Optional[int]:
    try:
        value = ast.literal_eval(node)
    except ValueError:
        return None
    return value if isinstance(value, int) else None


# --- cases ------------------------------------------------------------------------------------------------------------
# What a case fixes is known before anything is tested: an alternative of it is true for some cases, whatever is tested.


def _fixed_names(test: Function, module: Module, modules: Sequence[Module]) -> Set[str]:
    """Return the names whose values are fixed by the case that a test is given."""
    constants = {name: value for seen in _seen_by(module, modules) for name, value in seen.constants.items()}
    bound = _bound(test)
    fixed = {name for decorator in test.decorator_list for name in _parameters(decorator, constants)} - set(bound)
    before = -1
    while before != len(fixed):
        before = len(fixed)
        for name, values in bound.items():
            if all(value is not None and _fixed(value, fixed | module.imported) for value in values):
                fixed.add(name)
    return fixed | (module.imported - {each.arg for each in test.args.args})


def _parameters(decorator: ast.expr, constants: Dict[str, ast.expr]) -> Set[str]:
    """Return the names that a `parametrize` gives, also by a name of its own."""
    if isinstance(decorator, ast.Name):
        decorator = constants.get(decorator.id, decorator)
    if not isinstance(decorator, ast.Call) or _kinds(decorator.func) != {"parametrize"} or not decorator.args:
        return set()
    names = decorator.args[0]
    if isinstance(names, ast.Constant) and isinstance(names.value, str):
        return {each.strip() for each in names.value.split(",")}
    return {each.value for each in getattr(names, "elts", ()) if isinstance(each, ast.Constant)}


def _bound(test: Function) -> Dict[str, List[Optional[ast.expr]]]:
    """Return what each name in a test is bound to; None: what cannot be seen."""
    bound: Dict[str, List[Optional[ast.expr]]] = {}
    for node in ast.walk(test):
        pairs: List[Tuple[ast.expr, Optional[ast.expr]]] = []
        if isinstance(node, ast.Assign):
            pairs = [(target, node.value) for target in node.targets]
        elif isinstance(node, (ast.For, ast.comprehension)):
            pairs = [(node.target, node.iter)]
        elif isinstance(node, (ast.AugAssign, ast.AnnAssign, ast.NamedExpr)):
            pairs = [(node.target, None)]
        elif isinstance(node, ast.withitem) and node.optional_vars is not None:
            pairs = [(node.optional_vars, None)]
        for target, value in pairs:
            whole = isinstance(target, (ast.Name, ast.Tuple)) and not isinstance(value, _MUTABLE)
            for each in ast.walk(target):
                if isinstance(each, ast.Name):
                    bound.setdefault(each.id, []).append(value if whole else None)
    return bound


def _fixed(node: ast.expr, fixed: Set[str]) -> bool:
    """Tell whether a value is made of what is fixed alone."""
    called = {id(call.func) for call in _calls(node) if isinstance(call.func, ast.Name) and call.func.id in _PURE}
    for each in ast.walk(node):
        if isinstance(each, ast.Name) and id(each) not in called:
            if each.id not in fixed and not _CONSTANT.match(each.id) and not _CLASS.match(each.id):
                return False
        elif isinstance(each, ast.Call) and id(each.func) not in called:
            if not (isinstance(each.func, ast.Attribute) and each.func.attr in _TAKES):
                return False
        elif isinstance(each, (ast.Lambda, ast.Await, ast.Yield)):
            return False
    return True


def _by_case(node: ast.expr, fixed: Set[str]) -> bool:
    return any(isinstance(each, ast.Name) for each in ast.walk(node)) and _fixed(node, fixed)


def _sometimes_true(node: ast.expr, fixed: Set[str]) -> bool:
    """Tell whether an assertion has an alternative that the case fixes."""
    if isinstance(node, ast.IfExp):
        return _by_case(node.test, fixed) and (_always_true(node.body) or _always_true(node.orelse))
    if not isinstance(node, ast.BoolOp):
        return False
    if isinstance(node.op, ast.Or):
        return any(_by_case(each, fixed) for each in node.values) and not all(_fixed(e, fixed) for e in node.values)
    return any(_sometimes_true(each, fixed) for each in node.values)


def _for_each_case(body: Sequence[ast.stmt], fixed: Set[str], known: Set[str]) -> bool:
    """Tell whether an assertion is come to in every case."""
    for number, statement in enumerate(body):
        rest = body[number + 1 :]
        if isinstance(statement, ast.If) and _by_case(statement.test, fixed):
            return all(
                _for_each_case([*branch, *(() if _left(branch) else rest)], fixed, known)
                for branch in (statement.body, statement.orelse)
            )
        if isinstance(statement, (ast.With, ast.For)):
            if _for_each_case(statement.body, fixed, known) or _says(_head(statement), fixed, known):
                return True
        elif _says(statement, fixed, known):
            return True
        elif isinstance(statement, _ENDS):
            return False
    return False


def _left(branch: Sequence[ast.stmt]) -> bool:
    return bool(branch) and isinstance(branch[-1], _ENDS)


def _head(statement: Union[ast.With, ast.For]) -> ast.AST:
    heads = [statement.iter] if isinstance(statement, ast.For) else [item.context_expr for item in statement.items]
    return ast.Tuple(elts=heads, ctx=ast.Load())


def _says(statement: ast.AST, fixed: Set[str], known: Set[str]) -> bool:
    """Tell whether something is asserted, or the case is left out where everybody sees it."""
    for node in ast.walk(statement):
        if isinstance(node, ast.Assert):
            if not _sometimes_true(node.test, fixed):
                return True
        elif _asserts(node) or _called(node) & {*known, "skip"}:
            return True
    return False


def main() -> int:
    """Print what cannot fail, or may not end."""
    paths = [path for path in TEST.rglob("*.py") if not {"found", "recorded"} & set(path.parts)]
    found = hollow_tests(paths)
    for path, line, why in found:
        print(f"{path.relative_to(TEST.parent)}:{line}: {why}")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
