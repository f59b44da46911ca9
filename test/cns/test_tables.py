"""What is known of the CNS Flight Stack: md5 sums, codes, names."""

from __future__ import annotations

import pytest
from cns_definitions import MESSAGES, md5, service_md5

from amaze_autonomy.cns.tables import SERVICES, TOPICS, EntityStatus, code_of, component_of, worst
from amaze_autonomy.engine.rules import Code, Severity

OTHERS = {
    "watchdog_msgs/Status": "2d8e15e9a62c78ac92cd2a10638c1ee6",
    "watchdog_msgs/ActionStamped": "9c4baff1dfa2ceb3e6c061867a58251f",
}


@pytest.mark.parametrize("name", list(TOPICS.values()), ids=list(TOPICS))
def test_a_topic_has_the_md5_sum_of_its_fields(name):
    assert md5(name.type) == name.md5


@pytest.mark.parametrize("name", list(SERVICES.values()), ids=list(SERVICES))
def test_a_service_has_the_md5_sum_of_its_fields(name):
    assert service_md5(name.type) == name.md5


def test_so_have_what_is_inside_and_what_its_engine_sends():
    assert {name: md5(name) for name in OTHERS} == OTHERS
    assert set(OTHERS) <= set(MESSAGES)


@pytest.mark.parametrize(
    "status, codes",
    [
        (EntityStatus.NOMINAL, [1, 1, 1, 1]),
        (EntityStatus.STARTING, [2, 2, 2, 2]),
        (EntityStatus.DEFECT, [2, 2, 2, 2]),  # its 4 is not our 4
        (EntityStatus.UNDEF, [2, 2, 2, 2]),
        (EntityStatus.ERROR, [2, 4, 8, 16]),
        (99, [2, 4, 8, 16]),
    ],
)
def test_a_status_becomes_a_code_by_the_severity_of_the_mission(status, codes):
    assert [code_of(status, severity) for severity in Severity] == [Code(code) for code in codes]


@pytest.mark.parametrize(
    "entity, component",
    [
        ("lrf", "lrf"),
        ("px4_gps", "px4_gps"),
        ("/UWB-Tag 1", "uwb_tag_1"),
        ("7", "entity_7"),
        ("", "entity"),
        ("ä", "entity"),
    ],
)
def test_an_entity_becomes_a_component(entity, component):
    assert component_of(entity) == component


def test_the_worst_of_some_severities():
    assert worst((Severity.LOW, Severity.HIGH, Severity.MODERATE)) is Severity.HIGH
