"""Does a scenario fit this world? Everything it names is there, and every fault can do something to it."""

from __future__ import annotations

from typing import Optional

from amaze_autonomy.interface import PEERS, SERVICES
from amaze_autonomy.monitoring.specs import ComponentSpec

from .errors import NoEffectError, UnknownTargetError
from .scenario import ENGINE, Fault, Scenario, Subject
from .settings import Settings

__all__ = ["check_scenario"]

_OF_HEALTH = ("unhealthy", "unreported")
_OF_SAMPLES = ("slow", "flapping", "nan", "stuck")


def check_scenario(settings: Settings, scenario: Scenario, *, live: bool = False) -> None:
    """Check every fault and request of a scenario; `live`: the engine is another process.

    Raises:
        UnknownTargetError: a fault names something that is not there.
        NoEffectError: a fault would do nothing.
    """
    for fault in scenario.faults:
        _check_target(settings, fault)
        problem = _without_effect(settings, fault)
        if live and fault.target == ENGINE:
            problem = "the engine is another process; it is for virtual time"
        if problem is not None:
            raise NoEffectError(str(fault), problem, fault.where)
    for request in scenario.requests:
        known = tuple(mission.id for mission in settings.missions)
        for mission in request.missions:
            if mission not in known:
                raise UnknownTargetError("mission", mission, known)
        if live and request.missions:
            raise NoEffectError(str(request), "the user is another process; it is for virtual time")


def _check_target(settings: Settings, fault: Fault) -> None:
    components = tuple(component.name for component in settings.components)
    known = {Subject.COMPONENT: components, Subject.PROCESS: (*PEERS, ENGINE), Subject.SERVICE: tuple(SERVICES)}
    names = known.get(fault.kind.subject)
    if names is not None and fault.target not in names:
        raise UnknownTargetError(fault.kind.subject, fault.target, names, fault.where)
    if fault.has("platform") and fault.word("platform") not in ("", *settings.platforms):
        raise UnknownTargetError("platform", fault.word("platform"), settings.platforms, fault.where)


def _without_effect(settings: Settings, fault: Fault) -> Optional[str]:
    """Return why a fault would do nothing worth a test; None when it does something."""
    if fault.kind.targets and fault.target not in fault.kind.targets:
        return f"it is about {', '.join(fault.kind.targets)} only"
    if fault.kind.name == "restarted" and fault.for_ns is None:
        return "the engine would never be started again; say for how long with for_s"
    if fault.kind.subject != Subject.COMPONENT:
        return None
    component = next(each for each in settings.components if each.name == fault.target)
    if fault.kind.name in _OF_HEALTH and component.autopilot is None:
        return "the autopilot says nothing of this component"
    if fault.kind.name in _OF_SAMPLES and not component.topics:
        return "this component has no topics"
    if fault.kind.name == "reads" and not _has_range(settings, component):
        return f"it is not the range sensor ({settings.landing.topic})"
    return None


def _has_range(settings: Settings, component: ComponentSpec) -> bool:
    return any(topic.topic == settings.landing.topic for topic in component.topics)
