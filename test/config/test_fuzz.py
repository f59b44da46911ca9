"""Whatever is in the files: a configuration or a ConfigError, never anything else."""

from __future__ import annotations

from pathlib import Path
from typing import Callable
from unittest import mock

import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from amaze_autonomy import paths
from amaze_autonomy.config import ConfigError, document, load_configuration
from amaze_autonomy.config.document import parse

pytestmark = pytest.mark.long

FOLDER = paths.config_folder()
FILES = sorted(
    path.relative_to(FOLDER).as_posix() for pattern in ("*.yaml", "trajectories/*") for path in FOLDER.glob(pattern)
)
TEXTS = {name: (FOLDER / name).read_text(encoding="utf-8") for name in FILES}
MANY = settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])

SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=20),
    st.sampled_from(["never", "node", "px4", "highest", "/a/b", "~journal", "gps", "../x.csv", "1:30", "0x1f", "<<"]),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=8), inner, max_size=4)),
    max_leaves=8,
)


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the shipped configuration in which one file at a time is replaced, and put back."""
    folder = tmp_path_factory.mktemp("fuzz")
    for name, text in TEXTS.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def _mistake(call: Callable[[], object]) -> str:
    """Return the mistake that a call finds, empty when it is good; anything but a ConfigError is a failure."""
    try:
        call()
    except ConfigError as error:
        return str(error)
    return ""


def _mistake_in(folder: Path, name: str, content: bytes) -> str:
    """Return the mistake with one file replaced."""
    (folder / name).write_bytes(content)
    try:
        return _mistake(lambda: load_configuration(folder))
    finally:
        (folder / name).write_text(TEXTS[name], encoding="utf-8")


def _is_one_line(mistake: str, begin: str = "") -> bool:
    return mistake == "" or (mistake.isprintable() and mistake.startswith(begin))


@MANY
@given(name=st.sampled_from(FILES), data=st.data())
def test_a_file_with_a_piece_cut_replaced_or_doubled_is_good_or_one_mistake(copy, name, data):
    text = TEXTS[name]
    begin = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(begin, min(len(text), begin + 60)))
    piece = data.draw(st.one_of(st.just(""), st.just(text[begin:end] * 2), st.text(max_size=12)))
    content = (text[:begin] + piece + text[end:]).encode("utf-8", "surrogatepass")
    assert _is_one_line(_mistake_in(copy, name, content), str(copy))


@MANY
@given(name=st.sampled_from(FILES), content=st.binary(max_size=200))
@example(name="autonomy.yaml", content=b"\x00")
@example(name="autonomy.yaml", content=b"%YAML 3.0\n--- {}\n")
@example(name="autonomy.yaml", content=b'"\\ud800": 1\n')
@example(name="trajectories/square.csv", content=b"x,y,z,yaw\n1e999,0,0,0\n")
@example(name="trajectories/square.csv", content=b"# frame: \xff\nx,y,z,yaw\n0,0,2,0\n")
def test_a_file_of_any_bytes_is_good_or_one_mistake(copy, name, content):
    assert _is_one_line(_mistake_in(copy, name, content), str(copy))


def _addresses(tree: object, path: str) -> list:
    """Return the address of every key of a tree of plain values."""
    if isinstance(tree, dict):
        return [path, *(each for key, value in tree.items() for each in _addresses(value, f"{path}.{key}"))]
    return [path]


ADDRESSES = [each for file in ("autonomy", "sensors", "missions", "recording")
             for each in _addresses(load_configuration(FOLDER).effective[file], file)
             if each != file]  # fmt: skip


@MANY
@given(address=st.sampled_from(ADDRESSES), value=VALUES)
def test_any_value_of_any_key_is_good_or_one_mistake(address, value):
    assert _is_one_line(_mistake(lambda: load_configuration(FOLDER, {address: value})))


@MANY
@given(text=st.text(max_size=80))
def test_any_text_as_an_override_is_good_or_one_mistake(text):
    assert _is_one_line(_mistake(lambda: load_configuration(FOLDER, [text])), "override ")


@MANY
@given(text=st.text(max_size=60))
def test_any_text_parses_or_is_one_mistake(text):
    assert _is_one_line(_mistake(lambda: parse(text, "text")), "text")


@MANY
@given(text=st.one_of(st.text(max_size=60), st.text(alphabet="[]{}:,&*!|>-?#%@\"'\\\n aU0x8F", max_size=60)))
def test_the_parser_without_libyaml_is_as_calm(text):
    with mock.patch.object(document, "_LOADER", yaml.SafeLoader):
        assert _is_one_line(_mistake(lambda: parse(text, "text")), "text")


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith(".yaml")])
def test_both_parsers_read_the_same(name):
    with mock.patch.object(document, "_LOADER", yaml.SafeLoader):
        slow = parse(TEXTS[name], name)
    assert slow == parse(TEXTS[name], name)
