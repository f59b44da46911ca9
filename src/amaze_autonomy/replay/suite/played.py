"""What came of playing a case, and what every way of playing it needs: configuration and missions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Tuple

from amaze_autonomy.config.errors import ConfigError
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.config.model import Configuration
from amaze_autonomy.engine.mission import Mission
from amaze_autonomy.paths import config_folder

from ..errors import ReplayError
from ..expect.trace import Trace
from ..scenario.model import Case
from ..scenario.places import meant, place_of
from .task import Options

__all__ = ["Mark", "Played", "configuration_of", "missions_of", "written"]

_OVERRIDE = "override "
Mark = Tuple[str, float, Optional[float], str]


@dataclass(frozen=True)
class Played:
    """A run.

    Args:
        lines: of its journal, header first.
        trace: of it.
        vacuous: faults and requests of the scenario that did nothing, one line each.
        broken: why the input says nothing about the rules, one line each.
        marks: what went wrong and what the user asked, for reports.
    """

    lines: Tuple[str, ...]
    trace: Trace
    vacuous: Tuple[str, ...] = ()
    broken: Tuple[str, ...] = ()
    marks: Tuple[Mark, ...] = ()


def configuration_of(case: Case, options: Options) -> Configuration:
    """Return the configuration that a case is decided by: its own, unless the run names another.

    Raises:
        ConfigError: it has a mistake.
    """
    folder = options.configuration or case.configuration or config_folder()
    try:
        if not options.overrides:
            return load_configuration(folder, case.overrides)
        own = [f"{key}={written(value)}" for key, value in case.overrides.items()]
        return load_configuration(folder, [*own, *options.overrides])
    except ConfigError as error:
        raise _placed(error, case) from error


def _placed(error: ConfigError, case: Case) -> ConfigError:
    """Return a mistake in an override of the scenario's own with its line in the scenario."""
    key = error.file[len(_OVERRIDE) :].partition("=")[0]
    if not error.file.startswith(_OVERRIDE) or key not in case.overrides:
        return error
    place = place_of(case.path, ("configuration", "set", key), ("matrix", key))
    return ConfigError(place, f"{key.partition('.')[0]}.{error.key}" if error.key else key, error.wrong, error.right)


def written(value: Any) -> str:
    """Return a plain value as YAML."""
    if isinstance(value, list):
        return f"[{', '.join(written(each) for each in value)}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return "null" if value is None else repr(value)


def missions_of(case: Case, configuration: Configuration) -> Tuple[Mission, ...]:
    """Return the missions that a case flies.

    Raises:
        ReplayError: the configuration has no such mission.
    """
    known = {mission.id: mission for mission in configuration.missions}
    for name in case.missions:
        if name not in known:
            place = place_of(case.path, ("missions",), ("matrix", "missions"))
            raise ReplayError(f"{place}: there is no mission {name!r}; {meant(name, known)}")
    return tuple(known[name] for name in case.missions) or configuration.missions[:1]
