"""Tests that cannot fail, or may not end, are found, and those that do are not."""

from __future__ import annotations

from textwrap import dedent, indent

import hollow_tests
import pytest

ALWAYS = "this is always true"
NOTHING = "test_it asserts nothing"
EMPTY = "test_it asserts nothing when what it goes through is empty"
SOMETIMES = "for some of its cases this says nothing: give each what is expected of it"
CASES = "test_it asserts nothing for some of its cases"
SWALLOWED = "an assertion that fails in here is swallowed"
ANYTHING = "any exception will do, even of a name that is written wrongly: name it, or give a match"
ENDLESS = "this may wait for ever, and all tests after it: give it a limit"


@pytest.fixture
def found(tmp_path):
    """Return what is found in a text, as (line, why)."""

    def find(text, **others):
        for name, other in {"test_one": text, **others}.items():
            (tmp_path / f"{name}.py").write_text(dedent(other), encoding="utf-8")
        return [(each.line, each.why) for each in hollow_tests.hollow_tests(tmp_path.glob("*.py"))]

    return find


def a_test(body):
    return "def test_it(things, path):\n" + indent(dedent(body), "    ")


@pytest.mark.parametrize(
    "words",
    [
        "assert things == 1 or True",
        "assert True",
        "assert 'a text'",
        "assert (things == 1, 'a message')",
        "assert [things]",
        "assert not False",
        "assert things == things",
        "assert 1 and (things or 5)",
        "assert lambda: things",
    ],
)
def test_what_is_always_true_is_found(found, words):
    assert (2, ALWAYS) in found(a_test(words))


@pytest.mark.parametrize(
    "words",
    [
        "assert things",
        "assert things or path",
        "assert things == 1 and True",
        "assert things() == things()",
        "assert [*things]",
        "assert not things",
        "assert things < things + 1",
    ],
)
def test_what_may_be_false_is_not(found, words):
    assert found(a_test(words)) == []


@pytest.mark.parametrize(
    "body",
    [
        "things.go()",
        "pass",
        "return\nassert things",
        "if False:\n    assert things",
        "while 0:\n    assert things",
        "things.check = 1\nraise ValueError('no')\nassert things",
    ],
)
def test_a_test_that_asserts_nothing_is_found(found, body):
    assert found(a_test(body)) == [(1, NOTHING)]


@pytest.mark.parametrize(
    "body",
    [
        "if things:\n    assert path",
        "with path:\n    assert things",
        "try:\n    things()\nexcept ValueError:\n    assert path",
        "with pytest.raises(ValueError):\n    things()",
        "pytest.fail('no')",
        "raise AssertionError(things)",
        "checked(things)",
        "path.map(checked, things)",
        "Checker().check(things)",
        "with closed(things):\n    pass",
    ],
)
def test_an_assertion_that_is_come_to_somehow_is_one(found, body):
    helpers = """
        def checked(things):
            assert things

        class Checker:
            def check(self, things):
                checked(things)

        class closed:
            def __exit__(self, *_):
                assert self
        """
    assert found("from helpers import checked, Checker, closed\n" + a_test(body), helpers=helpers) == []


def test_a_helper_of_another_file_that_is_not_imported_is_none(found):
    assert found(a_test("checked(things)"), helpers="def checked(things):\n    assert things\n") == [(1, NOTHING)]


def test_a_fixture_that_asserts_at_its_end_is_one(found):
    fixture = """
        import pytest

        @pytest.fixture
        def things():
            yield 1
            assert now()
        """
    assert found(a_test("things.go()"), conftest=fixture) == []


@pytest.mark.parametrize(
    "body",
    [
        "for thing in things:\n    assert thing",
        "for thing in things.all():\n    for other in (1, 2):\n        assert thing",
        "for number in range(0):\n    assert number",
        "assert all(thing.good for thing in things)",
        "assert all(things)",
        "for thing in [each for each in (1, 2) if each in things]:\n    assert thing",
    ],
)
def test_a_loop_that_may_not_be_entered_is_found(found, body):
    assert found(a_test(body)) == [(1, EMPTY)]


@pytest.mark.parametrize(
    "body",
    [
        "assert things\nfor thing in things:\n    assert thing",
        "for thing in (1, 2):\n    assert thing in things",
        "for thing in ALL:\n    assert thing in things",
        "for thing in Kind:\n    assert thing in things",
        "for name, value in TABLE.items():\n    assert name in things",
        "for number, thing in enumerate(sorted(ALL)):\n    assert thing in things",
        "for number in range(3):\n    assert number in things",
        "for one, other in zip(ALL, TABLE):\n    assert one in things",
        "some = [1, *things]\nfor thing in some:\n    assert thing",
        "assert all(thing in things for thing in ALL)",
        "while things:\n    pass\nassert path",
    ],
)
def test_a_loop_that_is_entered_is_not(found, body):
    assert found("ALL = (1, 2)\nTABLE: dict = {1: 2}\n" + a_test(body)) == []


def test_what_hypothesis_draws_is_not_always_empty(found):
    body = "@given(things=lists())\n" + a_test("for thing in things:\n    assert thing")
    assert found(body) == []


@pytest.mark.parametrize("kind", ["Exception", "BaseException", "(ValueError, Exception)", "builtins.Exception"])
def test_any_exception_at_all_is_found(found, kind):
    assert found(a_test(f"with pytest.raises({kind}):\n    things()")) == [(2, ANYTHING)]
    assert found(a_test(f"with pytest.raises(expected_exception={kind}):\n    things()")) == [(2, ANYTHING)]
    assert found(a_test(f"with pytest.raises({kind}, match='no'):\n    things()")) == []


# --- cases ------------------------------------------------------------------------------------------------------------


def with_cases(body, before='@pytest.mark.parametrize("case, size", [("a", 1), ("b", 2)])'):
    """Return a test of two cases; its body begins in line 5."""
    return f"ALL = ('a', 'b')\n\n{before}\ndef test_it(case, size, things):\n" + indent(dedent(body), "    ")


@pytest.mark.parametrize(
    "words",
    [
        "things() or case == 'a'",
        "size > 1 or things()",
        "things.good or not size",
        "things() or size",
        "things() or case.startswith('a')",
        "things() or len(case) > size + 1",
        "things() or case in ALL",
        "things() or case in ('a', 'c')",
        "things() and (things.good or case != 'a')",
        "things() if case == 'a' else True",
        "case == 'a' or size == 2 or things()",
    ],
)
def test_what_is_true_for_some_cases_whatever_is_tested_is_found(found, words):
    assert (5, SOMETIMES) in found(with_cases(f"assert {words}\nassert things"))


@pytest.mark.parametrize(
    "words",
    [
        "things() == (case == 'a' or size == 2)",
        "things() or things.of(case)",
        "things.good or things.bad",
        "(things() or None) == case",
        "things() == (1 if case == 'a' else 2)",
        "not (things() or case == 'a')",
    ],
)
def test_what_says_something_for_every_case_is_not(found, words):
    assert found(with_cases(f"assert {words}")) == []


def test_what_is_taken_from_the_case_is_fixed_by_it(found):
    body = "one, *_ = case.split()\ntwo = (one, size)\nassert things() or two == ('a', 1)"
    assert found(with_cases(body)) == [(7, SOMETIMES), (4, CASES)]
    body = "one = things(case)\nassert things() or one == 'a'"
    assert found(with_cases(body)) == []


@pytest.mark.parametrize(
    "body",
    [
        "one = case\none = things()\nassert things() or one == 'a'",
        "one = [size]\none.append(things())\nassert things() or one",
        "one = list(case)\none[0] = things()\nassert things() or one",
        "one = size\none += things()\nassert things() or one",
        "with things as size:\n    assert things() or size",
    ],
)
def test_what_is_changed_meanwhile_is_not_fixed_by_the_case(found, body):
    assert found(with_cases(body)) == []


def test_what_a_loop_over_constants_goes_through_is_a_case(found):
    body = "for each in ALL:\n    assert things(each) or each == 'a'"
    assert (6, SOMETIMES) in found(with_cases(body))
    body = "for each in things:\n    assert things(each) or each == 'a'\nassert things"
    assert found(with_cases(body)) == []


def test_a_list_of_cases_may_have_a_name(found):
    named = "EACH = pytest.mark.parametrize('case', ALL)\n@EACH"
    assert found(with_cases("assert things() or case == 'a'", named)) == [(6, SOMETIMES), (5, CASES)]


def test_what_hypothesis_draws_is_no_case(found):
    assert found(with_cases("assert things() or case == 'a'", "@given(case=text(), size=integers())")) == []


@pytest.mark.parametrize(
    "body",
    [
        "if case == 'a':\n    assert things",
        "if size > 1:\n    assert things\nelse:\n    things()",
        "if case == 'a':\n    assert things\nelif size == 2:\n    assert things()",
        "if case == 'a':\n    return\nassert things",
        "if case == 'a':\n    with things:\n        assert things.good",
    ],
)
def test_a_test_that_asserts_for_some_of_its_cases_only_is_found(found, body):
    assert found(with_cases(body)) == [(4, CASES)]


@pytest.mark.parametrize(
    "body",
    [
        "if case == 'a':\n    assert things\nelse:\n    assert not things",
        "if case == 'a':\n    assert things\nassert things()",
        "if things():\n    assert things",
        "if case == 'a':\n    pytest.skip('not here')\nassert things",
        "if case == 'a':\n    assert things\n    return\nassert not things",
        "if case == 'a':\n    assert things\nelif size == 2:\n    assert things()\nelse:\n    assert not things",
        "if case == 'a':\n    things.go()\nassert things",
    ],
)
def test_a_test_that_asserts_for_each_case_is_not(found, body):
    assert found(with_cases(body)) == []


# --- assertions that are swallowed ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["AssertionError", "Exception", "BaseException", "(ValueError, AssertionError)"])
def test_an_assertion_whose_failure_is_caught_is_found(found, kind):
    assert found(a_test(f"with suppress({kind}):\n    assert things")) == [(2, SWALLOWED)]
    assert found(a_test(f"with contextlib.suppress({kind}):\n    assert things")) == [(2, SWALLOWED)]
    assert found(a_test(f"try:\n    assert things\nexcept {kind}:\n    pass")) == [(2, SWALLOWED)]
    assert found(a_test(f"try:\n    assert things\nexcept {kind}:\n    things()\nassert path")) == [(2, SWALLOWED)]


def test_an_assertion_whose_failure_is_caught_by_a_bare_except_is_found(found):
    assert found(a_test("try:\n    assert things\nexcept:\n    pass")) == [(2, SWALLOWED)]


@pytest.mark.parametrize(
    "body",
    [
        "with suppress(ValueError):\n    assert things",
        "with suppress(Exception):\n    things()\nassert things",
        "try:\n    assert things\nexcept AssertionError as error:\n    raise AssertionError(path) from error",
        "try:\n    assert things\nexcept Exception:\n    pytest.fail('no')",
        "try:\n    things()\nexcept Exception:\n    pass\nassert things",
        "try:\n    things()\nexcept Exception:\n    assert path",
        "try:\n    things()\nexcept Exception:\n    pass\nelse:\n    assert path",
    ],
)
def test_an_assertion_whose_failure_is_seen_is_not(found, body):
    assert (2, SWALLOWED) not in found(a_test(body))


# --- waits without a limit --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words",
    [
        "things.wait()",
        "things.thread.join()",
        "said, _ = things.communicate()",
        "path = things[0].get()",
        "path(things.result())",
        "things.acquire()",
        "subprocess.run(['ls'], check=True)",
        "path = subprocess.check_output(things).decode()",
        "subprocess.call(things)",
        "subprocess.check_call(things)",
        "urlopen(things)",
        "urllib.request.urlopen(things, b'data')",
        "socket.create_connection(('127.0.0.1', 1))",
        "things.terminate()\nthings.wait()",
        "things.send_signal(signal.SIGINT)\nthings.wait()",
        "os.killpg(things.pid, signal.SIGTERM)\nthings.wait()",
        "path.kill()\nthings.wait()",
        "things.wait()\nthings.kill()",
        "if path:\n    things.kill()\nthings.wait()",
        "things.kill()\nthings.communicate()",  # a child of it may hold the other end
        "while not things:\n    time.sleep(0.1)",
        "while True:\n    things.wait(0.1)",
    ],
)
def test_a_wait_without_a_limit_is_found(found, words):
    assert [why for _, why in found(a_test(f"{words}\nassert things"))] == [ENDLESS]


@pytest.mark.parametrize(
    "words",
    [
        "things.wait(10.0)",
        "things.wait(timeout=10.0)",
        "things.join(LIMIT_S)",
        "path = ', '.join(things)",
        "things.communicate(timeout=10.0)",
        "things.get(timeout=1.0)",
        "path = things.get('name')",
        "things.acquire(blocking=False)",
        "subprocess.run(things, check=True, timeout=60)",
        "subprocess.run(things, **path)",
        "subprocess.Popen(things)",
        "things.run()",
        "urlopen(things, timeout=5.0)",
        "urlopen(things, None, 5.0)",
        "socket.create_connection(path, 5.0)",
        "things.kill()\nthings.wait()",
        "things.send_signal(signal.SIGKILL)\npath()\nthings.wait()",
        "os.kill(things.pid, signal.SIGKILL)\nthings.wait()",
        "os.killpg(things.pid, signal.SIGKILL)\nthings.wait()",
        "things.one.kill()\nwith suppress(OSError):\n    things.one.wait()",
        "while not things and time.monotonic() < path:\n    time.sleep(0.1)",
        "while not things:\n    assert time.monotonic() < path\n    time.sleep(0.1)",
        "while things:\n    things.pop()",
        "while things.hear(0.1) is not None:\n    pass",
    ],
)
def test_a_wait_that_ends_is_not(found, words):
    assert found(a_test(f"{words}\nassert things")) == []


def test_a_wait_without_a_limit_is_found_in_helpers_and_fixtures(found):
    assert found("def ended(process):\n    return process.wait()\n") == [(2, ENDLESS)]
    assert found("@pytest.fixture\ndef it():\n    yield 1\n    subprocess.run(\n        [],\n    )\n") == [(4, ENDLESS)]
    assert found("def ended(process):\n    process.wait()  # hollow: a thread that nobody waits for\n") == []


def test_a_method_of_ours_that_waits_with_a_limit_is_none(found):
    asks = "from mine import Mine\ndef test_it(things):\n    Mine().wait()\n    assert things\n"
    mine = "class Mine:\n    def wait(self{}):\n        self.ended.wait({})\n"
    assert found(asks, mine=mine.format("", "5.0")) == []
    assert found(asks, mine=mine.format(", limit_s=1.0", "limit_s")) == []
    assert found(asks, mine=mine.format("", "")) == [(3, ENDLESS), (3, ENDLESS)], "the helper, and who calls it"
    assert found(asks, mine=mine.format(", limit_s", "limit_s")) == [(3, ENDLESS)], "it is another one's"
    assert found(asks.replace("mine", "other"), mine=mine.format("", "5.0")) == [(3, ENDLESS)]


def test_a_line_that_says_why_is_let_pass(found):
    assert found(a_test("things.go()").replace(":\n", ":  # hollow: it ends by itself\n", 1)) == []
    assert found(a_test("assert things or True  # hollow: an example\nassert path")) == []
    assert found(a_test("assert things or True  # hollow:\nassert path")) == [(2, ALWAYS)]


def test_it_is_said_with_file_and_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(hollow_tests, "TEST", tmp_path)
    (tmp_path / "test_two.py").write_text("\n\ndef test_it():\n    assert True\n", encoding="utf-8")
    assert hollow_tests.main() == 1
    shown = capsys.readouterr().out
    assert shown == f"{tmp_path.name}/test_two.py:4: {ALWAYS}\n{tmp_path.name}/test_two.py:3: {NOTHING}\n"
    (tmp_path / "test_two.py").write_text("def test_it(a):\n    assert a\n", encoding="utf-8")
    assert hollow_tests.main() == 0
    assert capsys.readouterr().out == ""
