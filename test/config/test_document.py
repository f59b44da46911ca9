"""What is wrong with a file before any key is looked at."""

from __future__ import annotations

import os

import pytest

from amaze_autonomy.config import ConfigError, Place, load_configuration
from amaze_autonomy.config.document import Items, Scalar, Table, entry_of, parse, read, replace


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "autonomy.yaml: is empty; must be one YAML document"),
        ("# nothing but a comment\n", "autonomy.yaml: is empty; must be one YAML document"),
        ("a: 1\n---\nb: 2\n", "autonomy.yaml:2: a second document starts here; must be one YAML document"),
        (
            "require_go: true\nflight: {}\nrequire_go: false\n",
            "autonomy.yaml:3: require_go: is given twice (first in line 1); must be given once",
        ),
        (
            "flight:\n  max_height_m: 3.0\n  max_height_m: 30.0\n",
            "autonomy.yaml:3: flight.max_height_m: is given twice (first in line 2); must be given once",
        ),
        (
            "flight: &one\n  max_height_m: 3.0\nchecks: *one\n",
            "autonomy.yaml:3: checks: *one is an alias; must be written out",
        ),
        ("flight: &a [*a]\n", "autonomy.yaml:1: flight.0: *a is an alias; must be written out"),
        (
            "flight:\n  <<: {max_height_m: 3.0}\n",
            "autonomy.yaml:2: flight.<<: is a merge key; must be written out: merge keys are not taken",
        ),
        (
            "require_go: !!python/object/apply:os.system ['true']\n",
            "autonomy.yaml:1: require_go: has the tag tag:yaml.org,2002:python/object/apply:os.system; "
            "must be written without a tag",
        ),
        (
            "require_go: !!bool 'true'\n",
            "autonomy.yaml:1: require_go: has the tag tag:yaml.org,2002:bool; must be written without a tag",
        ),
        ("? [1, 2]\n: 3\n", "autonomy.yaml:1: has a key that is not a word; must have plain keys"),
        (
            "- 1\n",
            "autonomy.yaml:1: is a list; must be a group of keys: require_go, checks, recording, takeoff, "
            "commands, landing, failsafe, battery, flight, streams",
        ),
        (
            "flight: " + "[" * 20 + "]" * 20,
            "autonomy.yaml:1: flight.0.0.0.0.0.0.0.0.0.0.0.0: is nested too deeply; must have at most 12 levels",
        ),
    ],
)
def test_a_mistake_in_the_document_is_one_line(mistake, text, message):
    assert mistake("autonomy.yaml", text) == message


def test_broken_yaml_is_named_with_its_line(mistake):
    message = mistake("autonomy.yaml", "flight:\n  max_height_m: [3.0\nchecks: {}\n")
    assert message.startswith("autonomy.yaml:3: is not YAML (")
    assert message.endswith("); must be one YAML document")


@pytest.mark.parametrize(
    "text, line",
    [
        ("require_go: true\nflight {}\nchecks: {}\n", 2),
        ("require_go: true\n\nflight {}\n\n\n", 3),
        ("require_go: true\nflight: {max_height_m: 3.0}\n'checks'\n\nbattery: {}\n", 3),
        ("require_go: true\nflight: 'up\nchecks: {}\nbattery: {}\n", 2),
        ('require_go: true\nflight: "a \\q\nchecks: {}\n', 2),
        ("require_go: 'a\nflight: \"a \\q\nchecks: b' c\n", 3),
    ],
)
def test_a_colon_or_a_quote_that_was_forgotten_is_named_with_its_own_line(mistake, text, line):
    assert mistake("autonomy.yaml", text).startswith(f"autonomy.yaml:{line}: is not YAML (")


def test_a_tab_is_named(mistake):
    message = mistake("autonomy.yaml", "flight:\n\tmax_height_m: 3.0\n")
    assert message.startswith("autonomy.yaml:2: is not YAML (")
    assert message.endswith("); must be one YAML document, indented with spaces: there is a tab")


def test_an_escape_of_a_character_that_there_is_not_is_no_yaml(mistake):
    assert mistake("autonomy.yaml", 'require_go: "\\UFFFFFFFF"\n').startswith("autonomy.yaml")


def test_a_hundred_thousand_brackets_are_refused_like_twenty(mistake):
    ours = "0.0.0.0.0.0.0.0.0.0.0.0.0: is nested too deeply; must have at most 12 levels"
    libyaml = "is not YAML (exceeded maximum nesting depth); must be one YAML document"  # that of PyYAML 6.0.4
    said = mistake("autonomy.yaml", "[" * 100_000)
    assert said in (f"autonomy.yaml:1: {ours}", f"autonomy.yaml:1: {libyaml}")


def test_a_huge_file_is_not_read_as_configuration(mistake):
    expected = "autonomy.yaml: has 1000001 bytes; must be a configuration of at most 1000000 bytes"
    assert mistake("autonomy.yaml", " " * 1_000_001) == expected


def test_what_is_not_utf8_is_named_with_its_line(small):
    (small / "autonomy.yaml").write_bytes(b"require_go: true\n# caf\xe9\n")
    with pytest.raises(ConfigError) as caught:
        load_configuration(small)
    assert str(caught.value) == f"{small}/autonomy.yaml:2: is not UTF-8; must be saved as UTF-8 text"


def test_a_missing_file_is_named(small):
    (small / "sensors.yaml").unlink()
    with pytest.raises(ConfigError) as caught:
        load_configuration(small)
    expected = f"{small}/sensors.yaml: cannot be read (No such file or directory); must be a readable file"
    assert str(caught.value) == expected


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(ConfigError) as caught:
        load_configuration(tmp_path / "none")
    right = "must hold autonomy.yaml, sensors.yaml, missions.yaml, recording.yaml, autopilot.yaml"
    assert str(caught.value) == f"{tmp_path}/none: is not a folder; {right}"


def test_an_error_has_its_parts_as_fields(small):
    (small / "autonomy.yaml").write_text("require_go: 1\n")
    with pytest.raises(ConfigError) as caught:
        load_configuration(small)
    error = caught.value
    assert (error.file, error.line, error.key, error.wrong, error.right) == (
        str(small / "autonomy.yaml"),
        1,
        "require_go",
        "is 1",
        "must be true or false",
    )


def test_a_message_is_one_line_whatever_the_key(mistake):
    message = mistake("autonomy.yaml", '"a\\nb\\e": 1\n')
    assert "\n" not in message
    assert message.startswith("autonomy.yaml:1: a\\nb\\x1b: is an unknown key; ")


def test_the_tree_knows_its_lines(tmp_path):
    (tmp_path / "a.yaml").write_text("one: 1\ntwo: [x, 2.5]\n")
    here = [Place(str(tmp_path / "a.yaml"), line) for line in (1, 2)]
    assert read(tmp_path / "a.yaml") == Table(
        here[0],
        {
            "one": (here[0], Scalar(here[0], "1", "int")),
            "two": (here[1], Items(here[1], (Scalar(here[1], "x", "str"), Scalar(here[1], "2.5", "float")))),
        },
    )


def test_plain_values_make_the_tree_that_their_yaml_would_make():
    place = Place("here")
    value = {"a": [1, 2.5, "x", True, None, "1"], "b": {}}
    assert entry_of(value, place) == parse('{a: [1, 2.5, x, true, null, "1"], b: {}}', "here", lines=False)


def test_what_is_not_plain_is_refused():
    with pytest.raises(ConfigError, match=r"^here: is a set; must be a plain value$"):
        entry_of({1, 2}, Place("here"))


def test_replacing_makes_the_tables_on_the_way_and_leaves_the_rest():
    place = Place("here")
    tree = entry_of({"a": 1, "c": [1, 2]}, place)
    assert replace(tree, ("b", "d"), entry_of(3, place)) == entry_of({"a": 1, "c": [1, 2], "b": {"d": 3}}, place)
    assert replace(tree, ("c", "1"), entry_of(3, place)) == entry_of({"a": 1, "c": [1, 3]}, place)


@pytest.mark.parametrize("path", [("a", "b"), ("c", "2"), ("c", "-1"), ("c", "x")])
def test_there_is_no_replacing_where_nothing_can_be(path):
    place = Place("here")
    assert replace(entry_of({"a": 1, "c": [1, 2]}, place), path, entry_of(3, place)) is None


@pytest.mark.parametrize("place", ["fifo", "/dev/zero", "folder"])
def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path, place):
    path = tmp_path / place
    if place == "fifo":
        os.mkfifo(path)
    elif place == "folder":
        path.mkdir()
    with pytest.raises(ConfigError, match="is no file; must be a readable file"):
        read(path)
