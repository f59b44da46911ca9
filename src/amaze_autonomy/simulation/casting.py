"""Does a scenario fit this world? Everything it names is there, and every fault can do something to it."""

from __future__ import annotations

from typing import Optional

from amaze_autonomy.monitoring.specs import ComponentSpec

from .errors import NoEffectError, UnknownTargetError
from .scenario import Fault, Scenario, Subject
from .services import PEERS, SERVICES
from .settings import Settings

__all__ = ["check_scenario"]

_OF_HEALTH = ("unhealthy", "unreported")
_OF_SAMPLES = ("slow", "flapping", "nan", "stuck")


def check_scenario(settings: Settings, scenario: Scenario) -> None:
    """Check every fault of a scenario.

    Raises:
        UnknownTargetError: a fault names something that is not there.
        NoEffectError: a fault would do nothing.
    """
    for fault in scenario.faults:
        _check_target(settings, fault)
        problem = _without_effect(settings, fault)
        if problem is not None:
            raise NoEffectError(str(fault), problem, fault.where)


def _check_target(settings: Settings, fault: Fault) -> None:
    components = tuple(component.name for component in settings.components)
    known = {Subject.COMPONENT: components, Subject.PROCESS: PEERS, Subject.SERVICE: SERVICES}
    names = known.get(fault.kind.subject)
    if names is not None and fault.target not in names:
        raise UnknownTargetError(fault.kind.subject, fault.target, names, fault.where)
    if fault.has("platform") and fault.word("platform") not in ("", *settings.platforms):
        raise UnknownTargetError("platform", fault.word("platform"), settings.platforms, fault.where)


def _without_effect(settings: Settings, fault: Fault) -> Optional[str]:
    """Return why a fault of a component would do nothing; None when it does something."""
    if fault.kind.targets and fault.target not in fault.kind.targets:
        return f"it is about {', '.join(fault.kind.targets)} only"
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
