"""What a launch file of the package would start, with the words of each node as the node itself reads them."""

from __future__ import annotations

import sys
from pathlib import Path
from unittest.mock import patch

from roslaunch.config import load_config_default
from roslaunch.node_args import create_local_process_args

from amaze_autonomy.ros.arguments import read_words, split_words

LAUNCH = Path(__file__).parents[2] / "launch"
OTHERS = ("console", "play")
"""Nodes with other words."""


def launched(file, *given):
    """Return (parameters by name, words by node) of a launch file with arguments."""
    with patch.object(sys, "argv", ["roslaunch"]):
        loaded = load_config_default([(str(LAUNCH / file), list(given))], None)
    parameters = {name: each.value for name, each in loaded.params.items()}
    return parameters, {node.name: words_of(node) for node in loaded.nodes if node.type not in OTHERS}


def words_of(node):
    _, *words = create_local_process_args(node, None)
    if node.type == "node_group":
        return split_words(words)[0]
    return read_words(node.type, words, *(("device",) if node.type == "mavlink_router" else ()))
