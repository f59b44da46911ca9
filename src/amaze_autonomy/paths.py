"""Where the files that are not Python code lie."""

from __future__ import annotations

from pathlib import Path


def config_folder() -> Path:
    """Find the configuration that ships with the package: the nearest one above this file.

    In a source tree, and so in a devel space and an editable installation, that is `config` beside `package.xml`. In an
    install space of catkin or colcon, a virtual environment, a user's or a system's installation it is
    `share/amaze_autonomy/config` under the same prefix that holds this module.

    Raises:
        FileNotFoundError: No folder above this module holds a configuration.
    """
    for folder in Path(__file__).resolve().parents:
        if (folder / "package.xml").is_file() and (folder / "config").is_dir():
            return folder / "config"
        installed = folder / "share" / "amaze_autonomy" / "config"
        if installed.is_dir():
            return installed
    message = f"no config folder of amaze_autonomy above {__file__}: reinstall the package"
    raise FileNotFoundError(message)


def expanded(place: str) -> Path:
    """Return a path with the home in the place of its ~; as it stands where that home is not known."""
    try:
        return Path(place).expanduser()
    except (KeyError, RuntimeError):  # no user of that name; or a user without a home, and no HOME
        return Path(place)
