"""The configuration: YAML files, read once and strictly, made into frozen values.

`load_configuration(folder)` is all that others need; what can be wrong with a file is a `ConfigError` of one line.
"""

from __future__ import annotations

from .errors import ConfigError, Place

__all__ = ["ConfigError", "Place"]
