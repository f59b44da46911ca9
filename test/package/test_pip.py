"""Plain `pip install .` into an environment without ROS, on whatever Python runs this."""

from __future__ import annotations

import sys

import pytest

pytestmark = [pytest.mark.builds, pytest.mark.xdist_group("pip")]


@pytest.fixture(scope="module")
def environment(tmp_path_factory, build_copy, shell):
    folder = tmp_path_factory.mktemp("pip")
    shell(f"{sys.executable} -m venv venv", folder)
    build_copy(folder / "source", "venv/bin/pip install -q ./source", folder)
    (folder / "source").rename(folder / "moved away")
    return folder


def test_the_offline_commands_run_without_ros(environment, shell):
    assert "check-config" in shell("venv/bin/amaze-autonomy --help", environment)
    assert "journal" in shell("venv/bin/amaze-replay --help", environment)


def test_the_configuration_that_was_installed_is_found_and_valid(environment, shell):
    program = "from amaze_autonomy.paths import config_folder; print(config_folder())"

    assert shell(f'venv/bin/python -c "{program}"', environment) == f"{environment}/venv/share/amaze_autonomy/config\n"
    shell("venv/bin/amaze-autonomy check-config", environment)


def test_topic_maps_are_part_of_the_package(environment):
    (package,) = environment.glob("venv/lib/python3*/site-packages/amaze_autonomy")

    assert list(package.glob("replay/maps/*.yaml"))
