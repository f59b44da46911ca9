"""One console at work on a link that is a list."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import pytest
from console_scenes import MISSIONS, SCENES

from amaze_autonomy.console.link import (
    AnswerCame,
    CollectingCame,
    Link,
    LinkClosed,
    LinkSays,
    Mailbox,
    MessagesCame,
    MissionsCame,
    MissionWanted,
    StateCame,
)
from amaze_autonomy.console.model import Collecting, Desk, Note, Verdict
from amaze_autonomy.console.session import Session
from amaze_autonomy.console.terminal import Wake


class ListLink(Link):
    def __init__(self):
        self.sent = []

    def start(self):
        """Nothing is far away."""

    def send(self, request):
        self.sent.append(request)

    def close(self):
        """Nothing was opened."""


class Console:
    """A session, its link, its mailbox and its clock."""

    def __init__(self, **options):
        self.now_s = 0.0
        self.link, self.mailbox = ListLink(), Mailbox(Wake())
        self.session = Session(
            Desk(), self.link, self.mailbox, now=lambda: self.now_s, clock=lambda: "10:00:00", **options
        )

    def happens(self, *happenings):
        for happening in happenings:
            self.mailbox.post(happening)
        self.session.turn()

    def shows(self, scene, **changes):
        self.happens(StateCame(replace(SCENES[scene].snapshot, **changes)))


@pytest.fixture
def console():
    return Console()


def test_a_mission_is_selected_and_its_answer_shown(console):
    console.shows("mission-input")
    console.happens(MissionsCame(console.link.sent[0].id, MISSIONS))
    for key in ("1", "enter", "y"):
        console.session.press(key)
    assert [request.words for request in console.link.sent] == ["list of missions", "mission 1"]
    console.happens(AnswerCame(console.link.sent[1].id, Verdict.REFUSED, "Battery."))
    answer = console.session.desk.answer
    assert (answer.request, answer.verdict, answer.message) == ("mission 1", Verdict.REFUSED, "Battery.")


def test_a_mission_by_parameter_is_selected_when_it_can_be(console):
    console.happens(MissionWanted(("2",)))
    console.shows("mission-input")
    console.happens(MissionsCame(console.link.sent[0].id, MISSIONS))
    assert [request.missions for request in console.link.sent] == [(), ("2",)]


def test_the_command_line_goes_before_the_parameter():
    console = Console()
    console.session.desk = replace(console.session.desk, wanted=("1",))
    console.happens(MissionWanted(("2",)))
    assert console.session.desk.wanted == ("1",)


def test_closing_sends_nothing_to_the_engine_and_says_so(console):
    console.shows("hold")
    console.session.press("q")
    console.session.press("y")
    assert (console.session.status, console.link.sent) == (0, [])
    assert (
        console.session.farewell()
        == "Console closed; that ends nothing else. The engine's last state: HOLD, IN FLIGHT."
    )


def test_an_interrupt_keeps_its_status_whatever_comes_after(console):
    console.shows("ready")
    console.session.end(130, "Interrupted.")
    console.happens(LinkClosed("ROS shut this console down."))
    assert console.session.status == 130
    assert (
        console.session.farewell()
        == "Interrupted. Console closed; that ends nothing else. The engine's last state: READY."
    )


def test_the_link_says_what_it_waits_for_until_the_engine_speaks(console):
    console.happens(LinkSays("Waiting for the ROS master at http://uav:11311"))
    assert console.session.desk.link == "Waiting for the ROS master at http://uav:11311"
    console.happens(LinkSays("", engine="/uav2/autonomy"))
    assert (console.session.desk.link, console.session.desk.engine) == ("", "/uav2/autonomy")


def test_an_end_of_ros_ends_the_console(console):
    console.happens(LinkClosed("ROS shut this console down."))
    assert (console.session.status, console.session.farewell()) == (0, "ROS shut this console down.")


def test_a_connection_that_fails_ends_the_console_with_another_status(console):
    console.happens(LinkClosed("No connection to ROS: the reason.", failed=True))
    assert (console.session.status, console.session.farewell()) == (2, "No connection to ROS: the reason.")


def test_no_engine_in_time():
    console = Console(wait_s=5.0)
    console.now_s = 4.9
    console.session.turn()
    assert console.session.status is None
    console.now_s = 5.1
    console.session.turn()
    assert (console.session.status, console.session.farewell()) == (4, "No engine on /autonomy within 5 s.")


def test_an_engine_that_falls_silent_is_waited_for():
    console = Console(wait_s=5.0)
    console.shows("hold")
    console.now_s = 500.0
    console.session.turn()
    assert console.session.status is None
    assert console.session.desk.stale(console.now_s)


@pytest.mark.parametrize(
    "result, data, status",
    [("COMPLETE", "COMPLETE", 0), ("COMPLETE", "INCOMPLETE", 3), ("COMPLETE", "", 0)]
    + [(result, "COMPLETE", 3) for result in ("LANDED_EARLY", "PILOT", "NOT_FLOWN")],
)
def test_once_ends_with_the_mission(result, data, status):
    console = Console(once=True)
    for scene in ("mission-input", "preflight", "mission", "data-cleanup"):
        console.shows(scene)
        assert console.session.status is None
    console.shows("mission-ended", result=result, data_result=data)
    assert console.session.status == status
    assert console.session.farewell().startswith(
        f"Mission ended: {result}, data INCOMPLETE." if data == "INCOMPLETE" else f"Mission ended: {result}."
    )


def test_once_does_not_end_with_the_mission_before():
    console = Console(once=True)
    console.shows("mission-ended")
    assert console.session.status is None


def test_once_ends_when_the_mission_is_given_up():
    console = Console(once=True)
    console.shows("outreach")
    console.shows("mission-input")
    assert (console.session.status, console.session.last_words) == (3, "The mission was given up.")


def test_once_goes_on_while_another_mission_is_queued():
    console = Console(once=True)
    console.shows("mission")
    console.shows("mission-ended", queue=("2",))
    assert console.session.status is None
    console.shows("mission-ended", queue=())
    assert console.session.status == 0


ONE_BEFORE = "Mission ended: COMPLETE. One before it was not, or its data is INCOMPLETE."


@pytest.mark.parametrize("lacks", [{"data_result": "INCOMPLETE"}, {"result": "LANDED_EARLY"}])
def test_once_remembers_a_bad_end_of_a_mission_while_another_is_queued(lacks):
    console = Console(once=True)
    console.shows("mission")
    console.shows("mission-ended", queue=("2",), **lacks)
    console.shows("mission")
    assert console.session.status is None
    console.shows("mission-ended")
    assert (console.session.status, console.session.last_words) == (3, ONE_BEFORE)


def ended(number, message="mission_ended_incomplete"):
    return Note("10:00:00", 2, "Mission ended.", "", number, message)


def test_once_remembers_lost_data_of_a_mission_whose_end_no_state_has_shown():
    """The engine begins the next mission at the same moment; its message alone tells."""
    console = Console(once=True)
    console.happens(MessagesCame("r-1", ()))
    console.shows("data-cleanup", queue=("2",))
    console.shows("preflight")
    console.happens(MessagesCame("r-1", (ended(1),)))
    console.shows("mission")
    console.happens(MessagesCame("r-1", (ended(1), ended(2, "mission_ended"))))
    console.shows("mission-ended")
    assert (console.session.status, console.session.last_words) == (3, ONE_BEFORE)


def test_once_counts_no_lost_data_of_a_mission_before_its_own():
    console = Console(once=True)
    console.happens(MessagesCame("r-1", (ended(1),)))
    console.shows("mission-ended", data_result="INCOMPLETE")
    console.happens(MessagesCame("r-1", (ended(1), ended(2))))
    console.shows("mission")
    console.happens(MessagesCame("r-1", (ended(1), ended(2), ended(3, "mission_ended"))))
    console.shows("mission-ended")
    assert (console.session.status, console.session.last_words) == (0, "Mission ended: COMPLETE.")


@pytest.mark.parametrize("once, status", [(True, 3), (False, 0)])
def test_whatever_else_ends_it_before_the_mission_is_no_good_end_with_once(once, status):
    def ends(how):
        console = Console(once=once)
        console.shows("mission")
        how(console)
        return console.session.status

    assert ends(lambda console: console.session.end(0, "Terminated.")) == status
    assert ends(lambda console: console.session.press("quit")) == status
    assert ends(lambda console: console.happens(LinkClosed("ROS shut this console down."))) == status
    assert ends(lambda console: console.session.end(130, "Interrupted.")) == 130
    assert ends(lambda console: console.happens(LinkClosed("No ROS.", failed=True))) == 2


# --- once, where nobody can name another mission ---


def unattended(wanted=("1",), **options):
    console = Console(once=True, **options)
    console.session.desk = replace(console.session.desk, wanted=wanted, interactive=False)
    return console


def lists(console):
    console.shows("mission-input")
    console.happens(MissionsCame(console.link.sent[0].id, MISSIONS))


@pytest.mark.parametrize(
    "wanted, words",
    [
        ("99", 'There is no mission "99". There are: 1, 2, wall.'),
        ("wall", "Mission wall cannot be flown: wall.csv line 7: z is -1.5 m, must be at least 0.5 m"),
    ],
)
def test_a_mission_that_cannot_be_selected_ends_it_where_nobody_can_name_another(wanted, words):
    console = unattended((wanted,))
    lists(console)
    assert (console.session.status, console.session.last_words) == (2, words)


def test_a_mission_that_the_engine_refuses_ends_it_where_nobody_can_name_another():
    console = unattended()
    lists(console)
    console.happens(AnswerCame(console.link.sent[1].id, Verdict.REFUSED, "Battery."))
    assert (console.session.status, console.session.last_words) == (2, "mission 1: REFUSED Battery.")


def test_a_mission_is_not_taken_for_that_of_somebody_else():
    console = unattended()
    console.shows("hold")
    assert console.session.status == 2
    assert console.session.last_words == "Mission 1 was not selected: the engine is in HOLD."


@pytest.mark.parametrize("verdict", [Verdict.DONE, Verdict.NO_ANSWER])
def test_a_mission_that_may_have_been_selected_is_waited_for(verdict):
    console = unattended()
    lists(console)
    console.happens(AnswerCame(console.link.sent[1].id, verdict))
    for scene in ("mission-input", "preflight", "mission"):
        console.shows(scene)
        assert console.session.status is None
    console.shows("mission-ended")
    assert console.session.status == 0


def test_what_was_typed_wrong_ends_it_once_nobody_types_any_more():
    console = Console(once=True)
    lists(console)
    console.session.typed("99")
    console.session.turn()
    assert console.session.status is None
    console.session.desk = replace(console.session.desk, interactive=False)
    console.session.turn()
    assert (console.session.status, console.session.last_words) == (
        2,
        'There is no mission "99". There are: 1, 2, wall.',
    )


def test_a_command_that_is_under_way_is_answered_before_it_ends():
    console = Console(once=True)
    lists(console)
    for line in ("99", "land"):
        console.session.typed(line)
    console.session.desk = replace(console.session.desk, interactive=False, error="Not sent: 99.")
    console.session.turn()
    assert console.session.status is None
    console.happens(AnswerCame(console.link.sent[1].id, Verdict.DONE))
    assert console.session.status == 2


def test_with_nothing_wanted_it_waits_for_the_mission_of_somebody_else():
    console = unattended(())
    lists(console)
    console.shows("mission")
    console.shows("mission-ended")
    assert console.session.status == 0


def test_it_ends_with_the_process_that_it_was_given():
    process = subprocess.Popen(["cat"], stdin=subprocess.PIPE)
    console = Console(pid=process.pid)
    console.shows("mission")
    assert console.session.status is None
    process.communicate(timeout=10)
    console.session.turn()
    assert (console.session.status, console.session.last_words) == (0, f"Process {process.pid} has ended.")


def test_without_once_it_stays(console):
    console.shows("mission")
    console.shows("mission-ended")
    assert console.session.status is None


def test_what_the_recorder_says_of_its_phase_is_stamped_and_counts_down(console):
    console.now_s = 7.0
    console.shows("data-cleanup-merging")
    console.happens(CollectingCame(Collecting("20261121T101431-001", "MERGING", 12.0)))
    assert console.session.desk.collecting == Collecting("20261121T101431-001", "MERGING", 12.0, 7.0)
    assert [console.session.desk.remaining_s(now_s) for now_s in (7.0, 9.5, 10.0, 10.1)] == [12.0, 9.5, 9.0, None]


def test_what_was_old_when_it_came_is_no_newer(console):
    console.now_s = 100.0
    console.happens(StateCame(SCENES["data-cleanup-merging"].snapshot, age_s=2.0))
    console.happens(CollectingCame(Collecting("20261121T101431-001", "MERGING", 12.0), age_s=2.0))
    desk = console.session.desk
    assert (desk.age_s(100.5), desk.heard(100.9), desk.heard(101.1)) == (2.5, True, False)
    assert [desk.remaining_s(now_s) for now_s in (100.0, 100.5, 101.1)] == [10.0, 9.5, None]


@pytest.mark.parametrize(
    "said",
    [
        Collecting("20261121T101431-001", "VERIFYING", 12.0),
        Collecting("20261121T101431-000", "MERGING", 12.0),
        Collecting("20261121T101431-001", "MERGING", None),
    ],
)
def test_a_time_that_belongs_to_something_else_or_is_not_known_is_not_shown(console, said):
    console.shows("data-cleanup-merging")
    console.happens(CollectingCame(said))
    assert console.session.desk.remaining_s(0.0) is None
