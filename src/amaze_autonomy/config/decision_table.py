"""The rules of the decision table: what a component's row may say, and what would never work."""

from __future__ import annotations

from typing import Any, Mapping

from amaze_autonomy.engine.severity import SEVERITIES, Severity, Verb

from .binding import refuse_at
from .kinds import Address, Places

__all__ = ["check_components", "waits"]


def waits(severity: str) -> bool:
    """Return whether a flight waits for a component of this severity."""
    return SEVERITIES[Severity(severity)].verb is Verb.WAIT


def check_components(components: Mapping[str, Any], places: Places) -> None:
    """Check each row of the decision table.

    Raises:
        ConfigError: about the first key that cannot be.
    """
    for name, component in components.items():
        here = ("components", name)
        _check_sources(component, here, places)
        _check_restart(component, here, places)
        _check_wait(component, here, places)
        for topic, values in component["topics"].items():
            _check_topic(values, (*here, "topics", topic), places)


def _check_sources(component: Mapping[str, Any], here: Address, places: Places) -> None:
    if not (component["topics"] or component["node"] or component["driver"] or component["autopilot"]):
        right = "must have a source: topics, node, driver or autopilot; nothing would be watched"
        refuse_at(here, places, "has no source", right)
    if component["autopilot"] and component["group"] != "px4":
        right = f"must be px4: the autopilot says how its {component['autopilot']} is"
        refuse_at((*here, "group"), places, f"is {component['group']}", right)


def _check_restart(component: Mapping[str, Any], here: Address, places: Places) -> None:
    restart, at = component["restart"], (*here, "restart")
    policy = restart["policy"]
    if component["group"] == "px4" and policy != "never":
        right = "must be never in group px4: the vehicle would be uncontrollable"
        refuse_at((*at, "policy"), places, f"is {policy}", right)
    if policy == "node" and not component["node"]:
        refuse_at(
            (*at, "policy"), places, "is node", "must be another one, or node must be given: there is none to restart"
        )
    if policy in ("driver", "command") and not restart["command"]:
        right = f"must be given with the policy {policy}: program and arguments"
        refuse_at((*at, "command"), places, "is missing", right)
    if policy in ("never", "node") and restart["command"]:
        right = "must be left out, or the policy must be driver or command"
        refuse_at((*at, "command"), places, f"is given with the policy {policy}", right)
    if restart["total_limit_s"] < restart["attempt_limit_s"]:
        right = f"must be at least attempt_limit_s ({restart['attempt_limit_s']:g})"
        refuse_at((*at, "total_limit_s"), places, f"is {restart['total_limit_s']:g}", right)


def _check_wait(component: Mapping[str, Any], here: Address, places: Places) -> None:
    at, wait, severity = (*here, "wait_limit_s"), component["wait_limit_s"], component["severity"]
    if waits(severity) and wait is None:
        right = f"must be given: with severity {severity} a flight waits, and every wait has a limit"
        refuse_at(at, places, "is missing", right)
    if not waits(severity) and wait is not None:
        what = "flown on without" if SEVERITIES[Severity(severity)].verb is Verb.CONTINUE else "landed for at once"
        right = f"must be left out: with severity {severity} it is {what}, nobody waits"
        refuse_at(at, places, f"is {wait:g}", right)
    restart = component["restart"]
    if wait is not None and restart["policy"] != "never" and wait < restart["attempt_limit_s"]:
        right = (
            f"must be at least restart.attempt_limit_s ({restart['attempt_limit_s']:g}): no restart would end in time"
        )
        refuse_at(at, places, f"is {wait:g}", right)


def _check_topic(values: Mapping[str, Any], here: Address, places: Places) -> None:
    period = 1.0 / values["rate_hz"]
    if values["age_limit_s"] < 3 * period - 1e-9:
        right = f"must be at least {3 * period:.6g}, three periods of rate_hz: one or two lost messages are no failure"
        refuse_at((*here, "age_limit_s"), places, f"is {values['age_limit_s']:g}", right)
    if values["window_s"] is not None and values["window_s"] < 4 * period - 1e-9:
        right = f"must be at least {4 * period:.6g}, four periods of rate_hz"
        refuse_at((*here, "window_s"), places, f"is {values['window_s']:g}", right)
    most = 1.0 - values["tolerance_fraction"]
    if not values["rate_failed_fraction"] < most:
        right = f"must be below 1 - tolerance_fraction ({most:g}): a slow topic comes before a failed one"
        refuse_at((*here, "rate_failed_fraction"), places, f"is {values['rate_failed_fraction']:g}", right)
