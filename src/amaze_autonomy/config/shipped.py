"""What a configuration that is written for somebody takes from the one that ships, as it stands there."""

from __future__ import annotations

import yaml

from ..paths import config_folder

_LISTS = ("parameters", "ardupilot_parameters", "offboard_parameters")
COMPARED = (
    "autopilot.yaml: before a takeoff parameters of the autopilot's failsafes are compared with the values that ship: "
    "compare them with what you want of your vehicle"
)


def compared_parameters() -> str:
    """Return the lists of parameters that are compared before a takeoff, with their comments.

    Raises:
        OSError: the file that ships cannot be read.
    """
    text = (config_folder() / "autopilot.yaml").read_text(encoding="utf-8")
    paragraphs = (each.strip("\n") for each in text.split("\n\n"))
    return "\n\n".join(each for each in paragraphs if (yaml.safe_load(each) or {}).keys() & set(_LISTS)) + "\n"
