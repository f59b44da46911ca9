"""The configuration: YAML files, read once and strictly, made into frozen values.

`load_configuration(folder)` is all that others need; what can be wrong with a file is a `ConfigError` of one line.
`schemas/` has a file for each YAML file; `consistency.py` is what must be true between them.
"""

from __future__ import annotations

from .errors import ConfigError, Place
from .loader import FILES, Overrides, hash_of, load_configuration
from .model import Configuration
from .schemas.autonomy import Streams
from .schemas.autopilot import AutopilotSettings, LinkSettings
from .schemas.recording import Platform, Recording, Storage, TopicGroup

__all__ = [
    "FILES",
    "AutopilotSettings",
    "ConfigError",
    "Configuration",
    "LinkSettings",
    "Overrides",
    "Place",
    "Platform",
    "Recording",
    "Storage",
    "Streams",
    "TopicGroup",
    "hash_of",
    "load_configuration",
]
