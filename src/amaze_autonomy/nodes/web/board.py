"""What the operator's page shows and asks for, without a server and without ROS.

`Board` takes in what the link to the engine posts and says what a viewer lacks: parts that are as they are (the state,
the missions, the recording), and lists in which nothing may be missed (messages, samples of the flight), by numbers.
All words are made here, by the functions that the console uses: the page only places them.

`Orders` takes the commands of viewers. A viewer on a bad link sends each again, under the same id, until it is
answered: each is carried out once at most by one server, and answered as often as it is asked for.
"""

from __future__ import annotations

import hmac
from collections import OrderedDict, deque
from dataclasses import dataclass, replace
from typing import Any, Deque, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from ...console import dialog
from ...console.keys import BINDINGS, Binding, offered
from ...console.link import AnswerCame, CollectingCame, Happening, LinkSays, MessagesCame, MissionsCame, StateCame
from ...console.model import STALE_AFTER_S, Desk, PendingFailure, Request, RequestKind, Snapshot, Telemetry, Verdict
from ...console.screen.style import tone_of_check, tone_of_code, tone_of_state
from ...console.screen.tables import action_words
from ...console.wire import clean
from ...console.words import OLD_S, age, duration, fraction, limits, quantity, readings, waypoint_words
from ...engine.events import SAFE, Check, UserCommand
from ...missions import Frame, MissionPlan, outlines

SAMPLES, TRACK = 1200, 2400
"""Samples that are kept: of the last ten minutes, at the 2 Hz of the engine's state; and of the whole flight, thinned.
page.js keeps as many."""
_SAMPLE_S = 0.25
_LIST_AGAIN_S = 5.0


class Have(NamedTuple):
    """What a viewer has already.

    Args:
        board: the id of the board it is from; of another one it has nothing.
        parts: the versions of the parts.
        run, note: the run of the engine, and the number of its last message.
        sample: the number of the last sample.
    """

    board: str = ""
    parts: Mapping[str, int] = {}
    run: str = ""
    note: int = 0
    sample: int = 0


_Sample = List[Any]
"""Number, time, position east and north, altitude, speed, battery, distance."""


class Board:
    """What is shown; one thread calls it.

    Args:
        board_id: another one for each process.
        plans: the missions, to be drawn.
    """

    def __init__(self, board_id: str, plans: Sequence[MissionPlan] = ()) -> None:
        self.id = board_id
        self.desk = Desk()
        drawn, safe = {plan.mission.id: plan_of(plan) for plan in plans}, [_button(each) for each in offered(None)]
        self._parts: Dict[str, Any] = {"plans": drawn, "safe": safe}
        self._versions: Dict[str, int] = dict.fromkeys(self._parts, 1)
        self._flight = _Flight()
        self._session = ""
        self._sample = 0
        self._sampled_s = -_SAMPLE_S
        self._listed_s = -_LIST_AGAIN_S
        self._measured = False  # the last sample is of something measured

    def take(self, happening: Happening, now_s: float) -> None:
        """Take in what has happened."""
        desk = self.desk
        if isinstance(happening, StateCame):
            if desk.snapshot is not None and not desk.snapshot.takes_mission and happening.snapshot.takes_mission:
                self._listed_s = -_LIST_AGAIN_S  # batteries and files may differ by now
            if desk.snapshot is not None and not desk.heard(now_s):
                self._forget_missions()
            self.desk = self.desk.with_state(happening.snapshot, now_s - happening.age_s)
            self._put("state", state_of(replace(happening.snapshot, checks=self.desk.checks(now_s))))
            if desk.collecting is not None:
                self._put("recording", recording_of(self.desk, now_s))
            self._add_sample(happening.snapshot, now_s)
        elif isinstance(happening, CollectingCame):
            self.desk = replace(desk, collecting=replace(happening.collecting, at_s=now_s - happening.age_s))
            self._put("recording", recording_of(self.desk, now_s))
        elif isinstance(happening, MessagesCame):
            if desk.run not in ("", happening.run):
                self._forget_missions()
            self.desk = replace(self.desk, run=happening.run, notes=happening.notes)
        elif isinstance(happening, MissionsCame):
            self.desk = replace(desk, missions=happening.missions)
            self._put("missions", missions_of(self.desk))
        elif isinstance(happening, LinkSays):
            self.desk = replace(desk, link=happening.text, engine=happening.engine or desk.engine)
            self._put("engine", {"name": self.desk.engine, "link": self.desk.link})

    def _forget_missions(self) -> None:
        """Have the missions listed anew: those that are known may be of an engine which is gone."""
        self.desk, self._listed_s = replace(self.desk, missions=None), -_LIST_AGAIN_S
        self._put("missions", [])

    def state_at(self, now_s: float) -> Optional[str]:
        """Return the name of the state in which the engine is; None: it is not heard."""
        return None if self.desk.snapshot is None or not self.desk.heard(now_s) else self.desk.snapshot.state

    def wants_missions(self, now_s: float) -> bool:
        """Return True when the engine is to be asked for its missions; says so once in a while."""
        snapshot = self.desk.snapshot
        if snapshot is None or not snapshot.takes_mission or now_s - self._listed_s < _LIST_AGAIN_S:
            return False
        known, self._listed_s = self._listed_s >= 0.0 and self.desk.missions is not None, now_s
        return not known

    def since(self, have: Have, now_s: float) -> Tuple[Dict[str, Any], Have]:
        """Return what a viewer lacks, and what it has then. The age of the engine's state is always among it."""
        have = have if have.board == self.id else Have(board=self.id, run=have.run, note=have.note)
        note = have.note if have.run == self.desk.run else 0
        notes = [each for each in self.desk.notes if each.number > note]
        parts = {name: value for name, value in self._parts.items() if self._versions[name] != have.parts.get(name)}
        silent = None if self.desk.snapshot is None else round(self.desk.age_s(now_s), 2)
        news = {
            "board": self.id,
            "age_s": silent,
            "parts": parts,
            "run": self.desk.run,
            "notes": [[each.number, each.clock, each.level, each.text, each.advice] for each in notes],
            "flight": self._flight.first,
            "samples": self._flight.after(have.sample),
        }
        last = notes[-1].number if notes else note
        return news, Have(self.id, dict(self._versions), self.desk.run, last, self._sample)

    def _put(self, name: str, value: Any) -> None:
        if self._parts.get(name) != value:
            self._parts[name] = value
            self._versions[name] = self._versions.get(name, 0) + 1

    def _add_sample(self, snapshot: Snapshot, now_s: float) -> None:
        said = snapshot.telemetry
        if snapshot.session_id not in ("", self._session):
            self._session, self._flight = snapshot.session_id, _Flight(self._sample + 1)
        measured = said.age is not None and said.age <= OLD_S
        if now_s - self._sampled_s < _SAMPLE_S or not (measured or self._measured):
            return
        self._sample, self._sampled_s, self._measured = self._sample + 1, now_s, measured
        if not measured:  # a gap: what stands in the state by now was measured before
            said = Telemetry()
        numbers = (said.position_x, said.position_y, said.altitude, said.speed, said.battery_fraction, said.distance)
        self._flight.add([self._sample, round(now_s, 2), *(None if n is None else round(n, 3) for n in numbers)])


class _Flight:
    """The samples of one mission: all of the last minutes; of what was before, each n-th, so that they do not grow.

    Args:
        first: number of its first sample; those with a lower one are of another mission.
    """

    def __init__(self, first: int = 1) -> None:
        self.first, self._step = first, 1
        self._last: Deque[_Sample] = deque(maxlen=SAMPLES)
        self._track: List[_Sample] = []

    def add(self, sample: _Sample) -> None:
        """Take the next sample."""
        self._last.append(sample)
        if sample[0] % self._step == 0:
            self._track.append(sample)
        if len(self._track) > TRACK:
            self._step *= 2
            self._track = [each for each in self._track if each[0] % self._step == 0]

    def after(self, number: int) -> List[_Sample]:
        """Return what is kept of the samples after one, in their order."""
        early = [each for each in self._track if each[0] < self._last[0][0]]
        return [each for each in (*early, *self._last) if each[0] > number]


# --- what is shown ----------------------------------------------------------------------------------------------------


def state_of(snapshot: Snapshot) -> Dict[str, Any]:
    """Return a state in the words in which it is shown."""
    tone = tone_of_state(snapshot.state, snapshot.result, snapshot.data_result)
    flown = f"mission {snapshot.mission_id} {snapshot.mission_description}".strip() if snapshot.mission_id else ""
    where = [
        snapshot.step.replace("_", " "),
        "IN FLIGHT" if snapshot.in_flight else "not in flight",
        flown,
        f"file {snapshot.file_index + 1} of {snapshot.files}" if snapshot.files > 1 else "",
        f"repetition {snapshot.repetition + 1} of {snapshot.repetitions}" if snapshot.repetitions > 1 else "",
        f"waypoint {waypoint_words(snapshot)}" if snapshot.in_flight and snapshot.waypoints else "",
        f"then mission {', '.join(snapshot.queue)}" if snapshot.queue else "",
    ]
    if snapshot.state == "MISSION_ENDED" and snapshot.result:
        data = f", data {snapshot.data_result}" if snapshot.data_result else ""
        where.insert(0, f"result {snapshot.result}{data}")
    return {
        "name": snapshot.state,
        "tone": tone.value,
        "where": [each for each in where if each],
        "in_flight": snapshot.in_flight,
        "takes_mission": snapshot.takes_mission,
        "mission": snapshot.mission_id,
        "file": snapshot.file_index,
        "left_s": snapshot.time_left_s,
        "limit": snapshot.limit,
        "message": snapshot.message,
        "level": snapshot.message_level,
        "advice": snapshot.advice,
        "waiting_for": snapshot.waiting_for,
        "faults": [_group(group, snapshot) for group in snapshot.fault_groups()],
        "checks": [_check(check) for check in snapshot.checks],
        "readings": [list(each) for each in readings(snapshot.telemetry)],
        "distance_limit": snapshot.telemetry.distance_limit,
        "battery_limit": snapshot.telemetry.battery_limit,
        "altitude_limit": snapshot.telemetry.altitude_limit,
        "commands": [_command(binding, snapshot) for binding in BINDINGS],
        "waypoint": [snapshot.waypoint, snapshot.waypoints],
        "recording": snapshot.recording_phase,
        "progress": snapshot.recording_progress,
        "data": snapshot.data_location,
    }


def _group(group: Tuple[PendingFailure, ...], snapshot: Snapshot) -> Dict[str, Any]:
    worst = group[0]
    return {
        "cause": worst.cause,
        "tone": tone_of_code(worst.code, worst.action).value,
        "action": action_words(replace(worst, time_left_s=None), 0.0) if snapshot.in_flight else "no takeoff",
        "left_s": worst.time_left_s,
        "limit": worst.limit,
        "faults": [[each.name, each.code or "", each.reason] for each in group],
    }


def _check(check: Check) -> Dict[str, Any]:
    return {
        "name": check.name,
        "verdict": check.verdict.value.upper(),
        "tone": tone_of_check(check.verdict).value,
        "value": quantity(check.value, check.unit),
        "limit": limits(check),
        "age": age(check.age_s),
        "advice": check.advice,
    }


def _button(binding: Binding) -> Dict[str, Any]:
    return {"name": binding.command.value, "words": binding.words, "question": binding.question}


def _command(binding: Binding, snapshot: Snapshot) -> Dict[str, Any]:
    answer = snapshot.answer_to(binding.command)
    return {
        **_button(binding),
        "possible": binding.command.value in snapshot.user_commands,
        "verdict": "" if answer is None else answer.verdict.value,
        "answer": "" if answer is None else answer.message,
    }


def recording_of(desk: Desk, now_s: float) -> Dict[str, Any]:
    """Return the recording on each platform."""
    said, left_s = desk.collecting, desk.remaining_s(now_s)
    doubt = _doubt_of_recording(desk, now_s)
    return {
        "left_s": None if left_s is None else round(left_s),
        "platforms": [
            {
                "name": each.platform,
                "growing": each.growing and not doubt,
                "size": f"{each.bytes / 1e6:.1f} MB",
                "rate": "-" if each.byte_rate is None or doubt else f"{each.byte_rate / 1e6:.2f} MB/s",
                "free": fraction(each.free_fraction),
                "cpu": fraction(each.cpu_fraction),
                "dropped": each.dropped,
                "trouble": doubt or each.message,
            }
            for each in (said.platforms if said is not None else ())
        ],
    }


def _doubt_of_recording(desk: Desk, now_s: float) -> str:
    """Return why what the recorder said last is not said of the present recording; empty: it is."""
    said, shown = desk.collecting, desk.snapshot
    if said is None or shown is None:
        return ""
    if now_s - said.at_s > STALE_AFTER_S:
        return f"not heard for {now_s - said.at_s:.0f} s"
    return "" if said.session_id == shown.session_id else f"of session {said.session_id or '-'}"


def missions_of(desk: Desk) -> List[Dict[str, str]]:
    """Return the missions that can be selected, each with the question that confirms it."""
    missions = desk.missions or ()
    return [
        {
            "id": row.id,
            "words": row.description or "no description",
            "duration": duration(row.duration_s),
            "battery": fraction(row.battery_needed),
            "error": row.error,
            "question": dialog.mission_question((row.id,), missions),
        }
        for row in missions
    ]


def plan_of(plan: MissionPlan) -> Dict[str, Any]:
    """Return what is drawn of a mission: metres east and north of the takeoff place, a line for each file."""
    return {
        "files": [
            [[round(point.x_m, 2), round(point.y_m, 2)] for point in trajectory.waypoints]
            if trajectory.frame is Frame.EAST_NORTH
            else []  # ahead and left of where it will stand: not known before the takeoff
            for trajectory in plan.trajectories
        ],
        **outlines(plan.fences),
    }


# --- orders -----------------------------------------------------------------------------------------------------------
# The commands of viewers.


_KEPT = 500  # answers; an order whose answer was forgotten is so old that nobody asks for it again
_OPEN = 16
_ANSWER_LIMIT_S = 10.0
_FRESH_S = 5.0
_LONGEST_ID, _MOST_MISSIONS = 64, 20


@dataclass
class _Order:
    request: Request
    asked_s: float
    answer: Optional[Dict[str, str]] = None


class Orders:
    """Commands that viewers gave, and what became of them.

    Args:
        board_id: an order that was meant for another process is not carried out: that one may have done it. What stops
            the vehicle or brings it down is: done twice it is the same.
        token: without it nobody commands.
    """

    def __init__(self, board_id: str, token: str) -> None:
        self._board, self._token = board_id, token.encode()
        self._orders: OrderedDict[str, _Order] = OrderedDict()
        self._next = 1_000_000  # request ids; lists of missions have lower ones

    def knows(self, token: Any) -> bool:
        """Return True when somebody may command."""
        return isinstance(token, str) and hmac.compare_digest(token.encode(), self._token)

    def take(
        self, order: Mapping[str, Any], state: Optional[str], now_s: float
    ) -> Tuple[Optional[Dict[str, str]], Optional[Request]]:
        """Take an order, perhaps once more: return its answer, if there is one yet, and the request to send, if any.

        Args:
            order: id, token, board, seen (the name of the state), beat (the time that the server sent last), and
                command or missions.
            state: in which the engine is; None: it is not heard.
            now_s: the time of `beat`.
        """
        order_id = order.get("id")
        if not isinstance(order_id, str) or not 0 < len(order_id) <= _LONGEST_ID:
            return None, None
        known = self._orders.get(order_id)
        if known is not None:
            return known.answer, None
        request = _request_of(order)
        refusal = self._refusal(order, request, state, now_s)
        if request is None or refusal is not None:
            verdict, words = refusal or (Verdict.REFUSED, "That is not a command.")
            return _answer(order_id, "" if request is None else request.words, verdict, words), None
        self._next += 1
        request = replace(request, id=self._next, sent_s=now_s)
        self._orders[order_id] = _Order(request, now_s)
        while len(self._orders) > _KEPT:
            self._orders.popitem(last=False)
        return None, request

    def _refusal(
        self, order: Mapping[str, Any], request: Optional[Request], state: Optional[str], now_s: float
    ) -> Optional[Tuple[Verdict, str]]:
        if not self.knows(order.get("token")):
            return Verdict.REFUSED, "The token is not the one of this vehicle: commands need it, looking does not."
        if request is None or request.command in SAFE:
            return None
        if order.get("board") != self._board:
            return Verdict.NO_ANSWER, "The page's server was started anew meanwhile. Look at the state, then ask again."
        if state is None:
            return Verdict.NO_ANSWER, "Not sent: no contact with the engine."
        if sum(each.answer is None for each in self._orders.values()) >= _OPEN:
            return Verdict.REFUSED, "Too many commands wait for their answers."
        if order.get("seen") != state:
            return Verdict.REFUSED, f"Not sent: the engine is in {state} by now."
        beat = order.get("beat")
        if not isinstance(beat, (int, float)) or not 0.0 <= now_s - beat <= _FRESH_S:
            return Verdict.NO_ANSWER, "Not sent: it was too long under way. Look at the state, then ask again."
        return None

    def answered(self, came: AnswerCame) -> Optional[Dict[str, str]]:
        """Take the engine's answer; return it for the viewers, None when nobody asked."""
        for order_id, order in self._orders.items():
            if order.request.id == came.request_id and order.answer is None:
                order.answer = _answer(order_id, order.request.words, came.verdict, came.message)
                return order.answer
        return None

    def overdue(self, now_s: float) -> List[Dict[str, str]]:
        """Return an answer for each order to which the engine gave none in time."""
        late = [
            (order_id, order)
            for order_id, order in self._orders.items()
            if order.answer is None and now_s - order.asked_s > _ANSWER_LIMIT_S
        ]
        for order_id, order in late:
            words = f"The engine has not answered within {_ANSWER_LIMIT_S:.0f} s."
            order.answer = _answer(order_id, order.request.words, Verdict.NO_ANSWER, words)
        return [order.answer for _, order in late if order.answer is not None]


def _request_of(order: Mapping[str, Any]) -> Optional[Request]:
    command, missions = order.get("command"), order.get("missions")
    if isinstance(command, str) and command in [each.value for each in UserCommand]:
        return Request(RequestKind.COMMAND, command=UserCommand(command))
    named = missions if isinstance(missions, list) and len(missions) <= _MOST_MISSIONS else []
    if named and all(isinstance(each, str) for each in named):
        return Request(RequestKind.SELECT, missions=tuple(clean(each, 40) for each in named))
    return None


def _answer(order_id: str, request: str, verdict: Verdict, message: str) -> Dict[str, str]:
    return {"id": order_id, "request": request, "verdict": verdict.value, "message": message}
