"""The reference in docs/ is what the schema says."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from amaze_autonomy import paths
from amaze_autonomy.config import FILES, ConfigError, load_configuration
from amaze_autonomy.config.kinds import Number
from amaze_autonomy.config.reference import file_reference, order_reference
from amaze_autonomy.config.schema import Group, Key, Named

DOCS = Path(__file__).parents[2] / "docs"


def test_every_file_and_the_order_of_limits_stand_in_the_page():
    page = (DOCS / "configuration.md").read_text(encoding="utf-8")
    for name in FILES:
        assert f"<!-- generated:{name}.yaml -->\n\n{file_reference(name).strip()}\n\n<!-- end -->" in page
    assert f"<!-- generated:order-of-limits -->\n\n{order_reference().strip()}\n\n<!-- end -->" in page


@pytest.mark.parametrize(
    "name, old, new",
    [
        ("sensors.yaml", "age_limit_s: 1.0, tol", "age_limit_ms: 500, tol"),
        ("sensors.yaml", "    autopilot: imu", "    autopilot: imu\n    restart: {policy: node}"),
        ("autonomy.yaml", "watchdog_heartbeat_limit_s: 0.6", "watchdog_heartbeat_limit_s: 0.3"),
        ("trajectories/square.csv", "# frame: east_north\n", ""),
    ],
)
def test_the_messages_that_the_page_shows_are_what_the_loader_says(tmp_path, name, old, new):
    folder = Path(shutil.copytree(paths.config_folder(), tmp_path / "config"))
    text = (folder / name).read_text(encoding="utf-8")
    assert old in text
    (folder / name).write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_configuration(folder)
    message = str(caught.value).replace(f"{tmp_path}/", "")
    assert f"\n{message}\n" in (DOCS / "configuration.md").read_text(encoding="utf-8")


def test_every_key_of_the_schema_has_a_row():
    def names(group: Group):
        for key in group.keys:
            yield key.name
            kind = key.kind.kind if isinstance(key.kind, Named) else key.kind
            if isinstance(kind, Group):
                yield from names(kind)

    assert FILES
    for file, group in FILES.items():
        text = file_reference(file)
        missing = [name for name in names(group) if f"`{name}`" not in text and f"{name}.<name>`" not in text]
        assert [name for name in missing if f".{name}`" not in text] == []


def test_a_row_says_what_is_taken_the_default_and_the_meaning(monkeypatch):
    group = Group(
        "one",
        (
            Key("age_limit_s", Number(above=0.0, maximum=5.0), "how old it may be", "old is bad", 0.5),
            Key("rate_hz", Number(minimum=1.0), "how often | it comes"),
            Key("window_s", Number(), "over which", "", None),
        ),
    )
    monkeypatch.setitem(FILES, "one", group)
    assert file_reference("one") == (
        "| Key | Takes | Default | Meaning |\n"
        "|---|---|---|---|\n"
        "| `age_limit_s` | a number above 0 and at most 5, in seconds | `0.5` | How old it may be (old is bad). |\n"
        "| `rate_hz` | a number at least 1, in Hz | must be given | How often \\| it comes. |\n"
        "| `window_s` | a number, in seconds | left out | Over which. |\n"
    )
