from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from amaze_autonomy import paths

ROOT = Path(__file__).parents[2]


def config_folder_seen_from(module: Path) -> subprocess.CompletedProcess:
    program = "import runpy, sys; print(runpy.run_path(sys.argv[1])['config_folder']())"
    return subprocess.run(
        [sys.executable, "-c", program, str(module)], capture_output=True, text=True, check=False, timeout=30
    )


def test_a_path_in_the_home_is_whole_and_one_in_a_home_that_nobody_has_stays(monkeypatch):
    monkeypatch.setenv("HOME", "/home/somebody")
    assert paths.expanded("~/recordings") == Path("/home/somebody/recordings")
    assert paths.expanded("/a/~b") == Path("/a/~b")
    assert paths.expanded("~nobody_of_this_name/recordings") == Path("~nobody_of_this_name/recordings")


@pytest.fixture
def tree(tmp_path):
    """Make a folder with the module as `module` and the configuration as `config`, both relative to it."""

    def make(module: str, config: str, *others: str) -> Path:
        for file in (f"{config}/autonomy.yaml", *others):
            (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / file).touch()
        (tmp_path / module).mkdir(parents=True)
        return Path(shutil.copy(paths.__file__, tmp_path / module))

    return make


@pytest.mark.parametrize(
    "module",
    [
        pytest.param("lib/python3.11/site-packages/amaze_autonomy", id="virtual environment"),
        pytest.param("lib/python3/dist-packages/amaze_autonomy", id="install space"),
        pytest.param("local/lib/python3.11/dist-packages/amaze_autonomy", id="system"),
        pytest.param("amaze_autonomy", id="pip --target"),
    ],
)
def test_an_installed_package_finds_its_configuration_under_its_prefix(tree, tmp_path, module):
    copy = tree(module, "share/amaze_autonomy/config")

    assert config_folder_seen_from(copy).stdout == f"{tmp_path}/share/amaze_autonomy/config\n"


def test_a_source_tree_uses_its_own_configuration(tree, tmp_path):
    copy = tree("src/amaze_autonomy", "config", "package.xml")

    assert config_folder_seen_from(copy).stdout == f"{tmp_path}/config\n"


def test_without_any_configuration_the_error_says_what_to_do(tree):
    copy = tree("src/amaze_autonomy", "elsewhere")

    result = config_folder_seen_from(copy)

    assert result.returncode == 1
    assert result.stderr.splitlines()[-1] == (
        f"FileNotFoundError: no config folder of amaze_autonomy above {copy}: reinstall the package"
    )
