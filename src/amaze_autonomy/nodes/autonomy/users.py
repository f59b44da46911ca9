"""The user's services: list and select missions, the commands of `UserCommand`. Each waits for the engine's answer.

A call that is not answered in time fails, and its words say what becomes of it. What nobody waits for any more is not
decided about, when the engine's thread comes to it: a vehicle that takes off long after its user was told that it does
not would surprise him. Nobody waits any more when the call has failed, when its asker has closed the connection, and
when it is old: it lay in a socket, for this process did not run. What stops the vehicle or brings it down is never too
late.
"""

from __future__ import annotations

import itertools
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence

import rospy
from std_srvs.srv import Trigger, TriggerResponse

from amaze_autonomy import msg, srv
from amaze_autonomy.engine.commands import Answer, AnswerKind
from amaze_autonomy.engine.events import SAFE, Event, MissionRejected, MissionSelected, Tick, UserCommand, UserRequest
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, State

from ...engine.context import Context
from ...engine.decide import available
from ...engine.events import Mission
from ...ros.asker import AskedService, Asker, asker_of
from ...ros.interface import number
from .engine_thread import UserEvent

_ANSWER_LIMIT_S = 3.0
_OLDEST_S = 3.0  # from when a request came to this computer until it is decided about
_LATE = "the engine did not answer in time; the command {what}"
_MAYBE, _NEVER = "may still be carried out", "is not carried out"
_OLD = "it came {age_s:.0f} s ago, and the engine did not run; it is not carried out: look at the state and ask again"
_GONE = "who asked has gone; it is not carried out"
_COMMANDS: Mapping[str, UserCommand] = {command.value: command for command in UserCommand}


def choose(missions: Sequence[Mission], ids: Sequence[str], t_ns: int, request_id: int = 0) -> UserEvent:
    """Return the event of a user who names missions by their ids."""
    known = {mission.id: mission for mission in missions}
    for mission_id in ids:
        if mission_id not in known:
            error = f"there is no such mission; there are {', '.join(known) or 'none'}"
            return MissionRejected(t_ns=t_ns, mission_id=mission_id, error=error, request_id=request_id)
    if not ids:
        return MissionRejected(t_ns=t_ns, mission_id="", error="no mission was named", request_id=request_id)
    return MissionSelected(t_ns=t_ns, missions=tuple(known[each] for each in ids), request_id=request_id)


def not_selected(state: EngineState, ids: Sequence[str]) -> str:
    """Return what a run that is gone on with, and has missions of its own, says of those that its launch names."""
    over = state.state in (State.MISSION_INPUT, State.MISSION_ENDED)
    now = () if over or state.session.mission is None else (state.session.mission,)
    missions = [mission.id for mission in (*now, *state.queue)]
    many = "s" if len(missions) > 1 else ""
    words = f"has mission{many} {', '.join(missions)}" if missions else "has ended its missions"
    return f"the run that is gone on with {words}; mission:={','.join(ids)} of this launch is not used"


@dataclass
class _Asked:
    """A request that a user waits for: who, its answer, and whether the engine has begun to decide about it."""

    asker: Asker
    answer: SimpleQueue[Answer] = field(default_factory=SimpleQueue)
    taken_up: bool = False


def _is_safe(event: UserEvent) -> bool:
    return isinstance(event, UserRequest) and event.command in SAFE


def _too_late(asker: Asker) -> str:
    """Return why nobody decides about what is asked; empty: it is in time."""
    if asker.age_s > _OLDEST_S:
        return _OLD.format(age_s=asker.age_s)
    return _GONE if asker.has_gone_behind_it() else ""


class UserDesk:
    """Takes requests of users to the engine, and its answers back to them.

    Args:
        missions: that can be selected.
        put: takes the events.
        now_ns: the clock that decides.
        least_battery: fraction below which no mission starts, whatever it needs.
    """

    def __init__(
        self,
        missions: Sequence[Mission],
        put: Callable[[Event], None],
        now_ns: Callable[[], int],
        least_battery: float = 0.0,
    ) -> None:
        self._missions, self._put, self._now_ns, self._least_battery = missions, put, now_ns, least_battery
        self._ids = itertools.count(1)
        self._lock = threading.Lock()  # held for a few steps and no wait: the engine's thread takes it, too
        self._waiting: Dict[int, _Asked] = {}
        self._services: List[Any] = []

    def open(self) -> None:
        """Offer the services."""
        self._services = [
            rospy.Service("~list_missions", srv.ListMissions, lambda _: self._list()),
            AskedService("~select_mission", srv.SelectMission, self._select),
        ]
        self._services.append(AskedService("~command", srv.UserCommand, self._named))
        for command in UserCommand:
            self._services.append(AskedService(f"~{command.value}", Trigger, partial(self._triggered, command)))

    def answer(self, answer: Answer) -> None:
        """Hand an answer to the user who waits for it."""
        with self._lock:
            asked = self._waiting.get(answer.request_id)
            if asked is not None:
                asked.answer.put(answer)

    def take_up(self, event: UserEvent) -> bool:
        """Tell whether what a user asks is still to be decided about; the engine's thread asks, just before it does."""
        if not event.request_id:
            return True  # a parameter's mission, a switch, who stands in for a user: nobody waits for an answer
        safe = _is_safe(event)
        with self._lock:
            asked = self._waiting.get(event.request_id)
            if asked is None:
                return safe
            asked.taken_up = safe or not (asked.asker.age_s > _OLDEST_S or asked.asker.has_gone())
            return asked.taken_up

    def _named(self, request: Any) -> Any:
        """Carry out the command that is named."""
        command = _COMMANDS.get(request.command)
        if command is None:
            message = f"there is no command {request.command!r}; there are {', '.join(_COMMANDS)}"
            return srv.UserCommandResponse(answer=AnswerKind.REFUSED.value, message=message)
        answer = self._command(command, asker_of(request))
        return srv.UserCommandResponse(answer=answer.answer.value, message=answer.message)

    def _triggered(self, command: UserCommand, request: Any) -> Any:
        """Carry out a command for who has no messages of ours; what is so already has succeeded."""
        answer = self._command(command, asker_of(request))
        return TriggerResponse(success=answer.answer is not AnswerKind.REFUSED, message=answer.message)

    def _command(self, command: UserCommand, asker: Asker) -> Answer:
        def make(request_id: int) -> UserEvent:
            return UserRequest(t_ns=self._now_ns(), command=command, request_id=request_id)

        return self._ask(make, asker, command.value, safe=command in SAFE)

    def _select(self, request: Any) -> Any:
        ids = [each.strip() for each in request.mission_ids]

        def make(request_id: int) -> UserEvent:
            return choose(self._missions, ids, self._now_ns(), request_id)

        answer = self._ask(make, asker_of(request), "select_mission")
        return srv.SelectMissionResponse(accepted=answer.answer is AnswerKind.DONE, message=answer.message)

    def _ask(self, make: Callable[[int], UserEvent], asker: Asker, name: str, *, safe: bool = False) -> Answer:
        """Put a request and wait for its answer; refuse what is too late already, unless it is never too late.

        Raises:
            rospy.ServiceException: There is none in time; it says what becomes of the request.
        """
        too_late = "" if safe else _too_late(asker)
        if too_late:
            rospy.logwarn("%s: %s", name, too_late)
            return Answer(request_id=0, answer=AnswerKind.REFUSED, message=too_late)
        asked = _Asked(asker)
        with self._lock:
            request_id = next(self._ids)
            self._waiting[request_id] = asked
        try:
            self._put(make(request_id))
            with suppress(Empty):
                return asked.answer.get(timeout=_ANSWER_LIMIT_S)
        finally:
            with self._lock:
                del self._waiting[request_id]
        if not asked.answer.empty():  # it came with the limit
            return asked.answer.get()
        words = _LATE.format(what=_MAYBE if asked.taken_up or safe else _NEVER)
        rospy.logwarn("%s: %s", name, words)
        raise rospy.ServiceException(words)

    def _list(self) -> Any:
        return srv.ListMissionsResponse(missions=[_info(mission, self._least_battery) for mission in self._missions])


def _info(mission: Mission, least_battery: float) -> msg.MissionInfo:
    needed = mission.battery_needed_fraction
    return msg.MissionInfo(
        id=mission.id,
        description=mission.description,
        files=mission.files,
        repetitions=mission.repetitions,
        estimated_duration=number(mission.estimated_duration_s),
        battery_needed=number(None if needed is None else max(needed, least_battery)),
    )


# --- unattended -------------------------------------------------------------------------------------------------------
# Who answers where nobody is there to: what `unattended:=true` does in a user's place, state in, command out.
#  It does no more than a user could: only what the engine would do if it were asked now, and a pilot's landing is
# acknowledged only once the flight is over for the engine as well, for nobody looks at the vehicle.


_AGAIN_NS = 1_000_000_000  # a request that came too late for its state is made again

_ANSWERS: Mapping[State, UserCommand] = {
    State.OUTREACH: UserCommand.GIVE_UP,
    State.PILOT: UserCommand.ACKNOWLEDGE,
}


class Unattended:
    """Says what to ask of the engine, at every step of it.

    Args:
        rules: that the engine decides by.
    """

    def __init__(self, rules: Rules) -> None:
        self._rules = rules
        self._again_ns = 0

    def answer(self, state: EngineState) -> Optional[UserCommand]:
        """Return what is to be asked of the engine now; None: nothing."""
        command = _ANSWERS.get(state.state)
        if command is None or state.flight.active:
            self._again_ns = 0
            return None
        context = Context(state, Tick(t_ns=state.t_ns), self._rules)
        if state.t_ns < self._again_ns or command not in available(context):
            return None
        over = context.stays_down() or context.unknown_for_long() or context.disarmed_for_long()
        if state.state is State.PILOT and not over:
            return None  # no single status ends what a pilot flies
        self._again_ns = state.t_ns + _AGAIN_NS
        return command
