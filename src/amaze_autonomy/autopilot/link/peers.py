"""Who is who on a link: our vehicle, other vehicles, and others that use our own address. Pure."""

from __future__ import annotations

from collections import deque
from typing import Any, Deque, Dict, List, NamedTuple, Optional, Tuple

from .dialect import Message, mavlink, source_of

HEAR_ONE_ALONE = "let mavros hear one vehicle alone (a link or port of its own)"
"""What to do where another vehicle is mixed into ours: another system id does not part them there."""
_OTHERS_KEPT = 16
_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1


class Identity:
    """Own address, and whom it listens to.

    Args:
        system: own system id; that of the vehicle, by convention.
        component: own component id, another for each node.
        vehicle: system id of the vehicle; 0: of the first autopilot that is heard.
    """

    def __init__(self, system: int, component: int, vehicle: int = 1) -> None:
        self.system, self.component, self.vehicle = system, component, vehicle


class Peers:
    """Tells the messages of our vehicle, to us, from all others.

    Args:
        identity: own address.
    """

    def __init__(self, identity: Identity) -> None:
        self._identity = identity
        self.vehicle: Optional[int] = identity.vehicle or None
        self.heartbeat_ns: Optional[int] = None
        self.others: List[int] = []
        self.doubles = 0
        self.sources = Sources()

    def take(self, t_ns: int, message: Message, place: Any = None) -> bool:
        """Return whether a message is from our vehicle's autopilot, and for us.

        Args:
            t_ns: when it came, which may be a while before it was read.
            message: that came.
            place: address that it came from; None: there is only one.
        """
        source, is_heartbeat = source_of(message), message.get_type() == "HEARTBEAT"
        if source == (self._identity.system, self._identity.component):
            self.doubles += 1
            return False
        if source[1] != _AUTOPILOT or (is_heartbeat and not is_vehicle(message)):
            return False
        if is_heartbeat and self.vehicle is None:
            self.vehicle = source[0]
        if source[0] != self.vehicle:
            if is_heartbeat:
                self._note(source[0])
            return False
        boot_ms = getattr(message, "time_boot_ms", None)
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED) if is_heartbeat else None
        if not self.sources.take(t_ns, place, message.get_seq(), boot_ms, armed=armed):
            return False
        if armed is not None:
            self.heartbeat_ns = t_ns
            self.sources.armed = armed
        return self._for_us(message)

    def pass_over(self, t_ns: int, source: Tuple[int, int], sequence: int, place: Any) -> None:
        """Note that a message came that nobody wants: its number belongs to the run of its sender."""
        if source == (self.vehicle, _AUTOPILOT):
            self.sources.take(t_ns, place, sequence)

    def age_ns(self, t_ns: int) -> Optional[int]:
        """Return the time since the last heartbeat of the vehicle; None: never."""
        return None if self.heartbeat_ns is None else t_ns - self.heartbeat_ns

    @property
    def address(self) -> Tuple[int, int]:
        """System and component to address the vehicle by; system 0, all, while it is not known."""
        return self.vehicle or 0, _AUTOPILOT

    def _note(self, system: int) -> None:
        if system not in self.others and len(self.others) < _OTHERS_KEPT:
            self.others.append(system)

    def _for_us(self, message: Message) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self._identity.system) and component in (0, self._identity.component)


def is_vehicle(heartbeat: Message) -> bool:
    """Tell an autopilot from ground stations, gimbals and companions."""
    return bool(heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID and heartbeat.type != mavlink.MAV_TYPE_GCS)


# --- sources ----------------------------------------------------------------------------------------------------------
# Who speaks as our vehicle: one source is it; another that says the same system id is a stranger. Pure.
#
# A source is an address and, behind one address (a router, a serial line), a run of MAVLink's sequence numbers with
# one boot time. The first one heard is ours. In flight it stays ours: a stranger is never believed, and our own
# silence is noticed although the stranger speaks. On the ground, where vehicles are exchanged and restarted, the next
# one is ours once ours has been silent for a while. A vehicle whose address changes in flight (a router that was
# restarted) is known by its boot time; one that lost its power, by a start after its last word, and as disarmed. What
# fits two runs alike is given to neither, unless all that came from there for a while was one run: then there is one
# vehicle, and the other run is what lost messages left of it.


_S = 1_000_000_000
_MS = 1_000_000
_NUMBERS = 256
_AHEAD = 16  # numbers that one message may be ahead of the last at once, and one more for each ms between them
_MOST_AHEAD = 64
_LATE = 32  # datagrams may overtake one another, by 50 ms of jitter at 450 messages a second and more
_PAUSE_NS = _S // 2  # after which any number goes on
_IN_A_ROW = 3  # messages that make a run one
_SILENCE_NS = 5 * _S // 2
_LASTING_NS = 3 * _S  # a run of another vehicle lasts; what bursts of lost messages leave of ours does not
_BOOT_NS = _S  # by which boot times of one vehicle differ at most: messages are under way for a while
_DRIFT = 4  # messages in which a later boot time counts
_ALONE = (_NUMBERS // 4, _LASTING_NS)  # messages and time without another one between, after which two runs are one
_ALONE_OF_ONE_BOOT = (16, 3 * _S // 10)  # likewise, of runs that say the same boot time
REMEMBERED_NS = 10 * _S
_TOLD_NS = 30 * _S  # for which one behind our address stays told: near ours, its run ends and begins now and then
_POWERLESS_NS = 10 * _S  # as long as a vehicle is silent at least whose battery is exchanged
_BETWEEN = 3  # numbers between two of ours that are no chance
_SOURCES_KEPT = 8
_AVERAGED = 16  # gaps
_ENDED_GAPS, _ENDED_NS = 5, _S // 10  # without a word in which a run ends that another one follows


class _Run:
    """Messages that follow one another.

    Args:
        t_ns: of the first one.
        place: where it came from.
        sequence: its number.
    """

    def __init__(self, t_ns: int, place: Any, sequence: int) -> None:
        self.place, self.sequence = place, sequence
        self.first_ns = self.heard_ns = t_ns
        self.maybe_ns = t_ns  # of the last message that was of this run, or of another one
        self.count = self.gap_ns = 0
        self.earliest_ns: Optional[int] = None  # boot time that was heard: a message can only be late
        self.boot_ns: Optional[int] = None  # the same, going along with a clock that runs slower than ours
        self.told_ns = t_ns  # when it was told last
        self.late_ns = 0  # by how much that message was late
        self.armed: Optional[bool] = None  # by its last heartbeat
        self.before_ns: Optional[int] = None  # when it was heard before a pause since which it has told no boot time
        self.resumed_ns = t_ns  # the end of that pause

    def hear(self, t_ns: int, sequence: int, boot_ns: Optional[int]) -> None:
        late = (sequence - self.sequence) % _NUMBERS >= _NUMBERS - _LATE
        if not late or t_ns - self.heard_ns > _PAUSE_NS:
            self.sequence = sequence
        self._note_pause(t_ns)
        self.gap_ns += (t_ns - self.heard_ns - self.gap_ns) // _AVERAGED
        self.heard_ns = t_ns
        self.count += 1
        if boot_ns is not None:
            self.before_ns = None
            self._tell(t_ns, boot_ns)

    def _note_pause(self, t_ns: int) -> None:
        """Note the first of several pauses: who was started again says heartbeats alone for a while."""
        if t_ns - self.heard_ns <= max(_PAUSE_NS, _ENDED_GAPS * self.gap_ns):
            return
        if self.before_ns is None or t_ns - self.resumed_ns > REMEMBERED_NS:
            self.before_ns, self.resumed_ns = self.heard_ns, t_ns

    def give_back(self, t_ns: int, sequence: int, boot_ns: int) -> None:
        """Give back what was heard since a pause to a vehicle that was started in it: this one had lost its power.

        Its numbers go on from what was heard since; those of a stranger do so by chance alone.
        """
        if self.before_ns is None or t_ns - self.resumed_ns > REMEMBERED_NS:
            return
        if not 0 < (sequence - self.sequence) % _NUMBERS <= _AHEAD:
            return
        if boot_ns > self.before_ns and self.denies(t_ns, boot_ns):
            self.heard_ns, self.before_ns = self.before_ns, None

    def _tell(self, t_ns: int, boot_ns: int) -> None:
        self.told_ns = t_ns
        if self.earliest_ns is None or self.boot_ns is None:
            self.earliest_ns = self.boot_ns = boot_ns
        self.earliest_ns = min(self.earliest_ns, boot_ns)
        self.late_ns = max(0, boot_ns - self.boot_ns)
        if not self.late_ns:
            self.boot_ns = boot_ns
        elif self.late_ns <= _BOOT_NS:  # clocks go apart, those of slow simulations by much
            self.boot_ns += self.late_ns // _DRIFT

    def follows(self, t_ns: int, sequence: int) -> bool:
        """Return whether a number is one of the next, or of the last."""
        ahead = (sequence - self.sequence) % _NUMBERS
        return ahead >= _NUMBERS - _LATE or ahead <= min(_MOST_AHEAD, _AHEAD + (t_ns - self.heard_ns) // _MS)

    def denies(self, t_ns: int, boot_ns: int) -> bool:
        """Return whether a vehicle that was started at this time is another one."""
        if self.boot_ns is None or self.earliest_ns is None:
            return False
        grown_ns = self.late_ns + t_ns - self.told_ns  # what comes in order is later than the last by no more
        return not self.earliest_ns - _BOOT_NS <= boot_ns <= self.boot_ns + _BOOT_NS + grown_ns

    def silent_ns(self, t_ns: int) -> int:
        """Return for how long nothing came that can be of this run."""
        return t_ns - max(self.heard_ns, self.maybe_ns)


class _Between:
    """Numbers that lie between two of ours that follow one another, far from both: they are somebody else's.

    So one is noticed that says heartbeats alone: ours passes over its numbers, and it never makes a run.
    """

    def __init__(self) -> None:
        self._sequence: Optional[int] = None
        self._heard_ns = 0
        self._far = False  # whether the last number was
        self._times_ns: Deque[int] = deque(maxlen=_BETWEEN)

    def add(self, t_ns: int, sequence: int) -> None:
        """Take the number of any message that came from our address."""
        ahead = 0 if self._sequence is None else (sequence - self._sequence) % _NUMBERS
        if not self._far and _MOST_AHEAD < ahead < _NUMBERS - _LATE:
            self._far = True
            return
        if self._far and ahead == 1 and t_ns - self._heard_ns <= _PAUSE_NS:
            self._times_ns.append(t_ns)
        self._far, self._sequence, self._heard_ns = False, sequence, t_ns

    @property
    def last_ns(self) -> int:
        """When the last one came."""
        return self._times_ns[-1] if self._times_ns else 0

    def tells(self, t_ns: int) -> bool:
        """Return whether there were several lately."""
        return len(self._times_ns) == _BETWEEN and t_ns - self._times_ns[0] <= REMEMBERED_NS


class _Told(NamedTuple):
    """Strangers behind our address that were told.

    Args:
        t_ns: when they spoke beside ours last.
        place: the address.
        names: in words.
    """

    t_ns: int
    place: Any
    names: Tuple[str, ...]


class Sources:
    """The sources that speak as one system id."""

    def __init__(self) -> None:
        self._runs: List[_Run] = []
        self._ours: Optional[_Run] = None
        self._unbroken: Dict[Any, _Run] = {}  # all that came from an address with more than one run, while it is one
        self._nearly: Dict[Any, _Run] = {}  # the same, where datagrams overtake one another or come twice
        self._told: Optional[_Told] = None
        self._between = _Between()
        self.armed = False

    def take(
        self, t_ns: int, place: Any, sequence: int, boot_ms: Optional[int] = None, *, armed: Optional[bool] = None
    ) -> bool:
        """Return whether a message is of our vehicle.

        Args:
            t_ns: when it came.
            place: address it came from; None: there is only one.
            sequence: its number.
            boot_ms: since its start, when the message says so.
            armed: what it says of that, when it is a heartbeat.
        """
        boot_ns = t_ns - boot_ms * _MS if boot_ms else None
        ours = self._ours
        if ours is not None and ours.place == place:
            self._between.add(t_ns, sequence)
        alone = ours is not None and len(self._runs) == 1 and ours.place == place and boot_ns is None
        if ours is not None and alone and ours.follows(t_ns, sequence):  # as it is nearly always
            ours.hear(t_ns, sequence, None)
            return True
        run = self._run_of(t_ns, place, sequence, boot_ns)
        if run is None:
            return False
        run.hear(t_ns, sequence, boot_ns)
        run.armed = run.armed if armed is None else armed
        self._elect(t_ns, run)
        return run is self._ours

    def strangers(self, t_ns: int) -> Tuple[str, ...]:
        """Return where others that say our vehicle's id speak from."""
        ours = self._ours
        if ours is None:
            return ()
        others = [run for run in self._runs if run is not ours and t_ns - run.heard_ns <= REMEMBERED_NS]
        beside = [run for run in others if run.place != ours.place]
        spoke_ns, behind = self._behind(t_ns, ours, [run for run in others if run.place == ours.place])
        names = [_name(run.place) + _start(run, ours) for run in beside]
        if behind:
            told = tuple(f"{_name(ours.place)}, where ours is, too{start}" for start in behind)
            self._told = _Told(spoke_ns, ours.place, told)
        if self._told is not None and self._told.place == ours.place and t_ns - self._told.t_ns <= _TOLD_NS:
            names += self._told.names
        return tuple(dict.fromkeys(names))

    def _behind(self, t_ns: int, ours: _Run, others: List[_Run]) -> Tuple[int, List[str]]:
        """Return when strangers behind our address spoke last, and what is said of the start of each, of these runs."""
        lasting = [run for run in others if self._goes_on_beside(t_ns, run)]
        if lasting:
            return max(run.heard_ns for run in lasting), [_start(run, ours) for run in lasting]
        if not self._between.tells(t_ns):
            return t_ns, []
        return self._between.last_ns, [_start(run, ours) for run in others if run.count >= _IN_A_ROW] or [""]

    @staticmethod
    def _goes_on_beside(t_ns: int, run: _Run) -> bool:
        """Return whether a run behind our address lasts: what a burst of lost messages leaves does not."""
        lasts = run.count >= _IN_A_ROW and run.heard_ns - run.first_ns >= _LASTING_NS
        return lasts and t_ns - run.heard_ns <= _SILENCE_NS

    def forget(self) -> None:
        """Forget all: the link was opened again. In flight the boot time of ours is kept."""
        self._runs = [self._ours] if self.armed and self._ours is not None else []
        self._ours = self._runs[0] if self._runs else None
        self._told, self._between = None, _Between()
        self._unbroken.clear()
        self._nearly.clear()

    # --- inside ---------------------------------------------------------------------------------------------------

    def _run_of(self, t_ns: int, place: Any, sequence: int, boot_ns: Optional[int]) -> Optional[_Run]:
        here = [run for run in self._runs if run.place == place]
        if len(here) > 1:
            self._note_unbroken(t_ns, place, sequence)
        if boot_ns is not None:
            here = [run for run in here if not run.denies(t_ns, boot_ns)]
        fits = [run for run in here if run.follows(t_ns, sequence)]
        if len(fits) > 1:
            fits = self._without_jumps(t_ns, fits)
        if len(fits) > 1:
            return self._one_vehicle(t_ns, fits)
        if fits:
            return fits[0]
        if len(here) == 1 and t_ns - here[0].heard_ns > _PAUSE_NS:
            return here[0]
        if boot_ns is not None and self._ours is not None and self._ours.place == place:
            self._ours.give_back(t_ns, sequence, boot_ns)
        return self._begin(t_ns, place, sequence)

    def _without_jumps(self, t_ns: int, fits: List[_Run]) -> List[_Run]:
        """Return the runs that are vehicles, of those that a message goes on with; what only began has jumped."""
        first = self._ours if self._ours in fits else fits[0]
        real = [run for run in fits if run is first or self._is_vehicle(t_ns, run, first)]
        self._runs = [run for run in self._runs if run not in fits or run in real]
        return real

    def _note_unbroken(self, t_ns: int, place: Any, sequence: int) -> None:
        run = self._unbroken.get(place)
        if run is None or not 0 < (sequence - run.sequence) % _NUMBERS <= _AHEAD or t_ns - run.heard_ns > _S:
            run = self._unbroken[place] = _Run(t_ns, place, sequence)
        run.hear(t_ns, sequence, None)
        nearly = self._nearly.get(place)
        if nearly is None or not nearly.follows(t_ns, sequence) or t_ns - nearly.heard_ns > _S:
            nearly = self._nearly[place] = _Run(t_ns, place, sequence)
        nearly.hear(t_ns, sequence, None)

    def _one_vehicle(self, t_ns: int, fits: List[_Run]) -> Optional[_Run]:
        """Return the run that a message goes on with when all that it fits are one vehicle; None: they may be two."""
        first = self._ours if self._ours in fits else fits[0]
        unbroken = self._unbroken[first.place]
        others = [run for run in fits if run is not first]
        if any(run.boot_ns is not None and first.denies(t_ns, run.boot_ns) for run in others):
            return self._neither(t_ns, fits)
        alone = _lasts(t_ns, unbroken, _ALONE)
        if all(_same_boot(run, first) for run in others):
            alone = _lasts(t_ns, unbroken, _ALONE_OF_ONE_BOOT) or _lasts(t_ns, self._nearly[first.place], _ALONE)
        if not alone:
            return self._neither(t_ns, fits)
        self._runs = [run for run in self._runs if run is first or run not in fits]
        first.sequence = unbroken.sequence
        return first

    @staticmethod
    def _neither(t_ns: int, fits: List[_Run]) -> None:
        for run in fits:
            run.maybe_ns = t_ns

    @staticmethod
    def _is_vehicle(t_ns: int, run: _Run, first: Optional[_Run]) -> bool:
        if t_ns - run.heard_ns > _S:
            return False
        if run.boot_ns is not None and first is not None and first.denies(t_ns, run.boot_ns):
            return True
        return run.count >= _IN_A_ROW

    def _begin(self, t_ns: int, place: Any, sequence: int) -> _Run:
        self._runs = [run for run in self._runs if run is self._ours or t_ns - run.heard_ns <= REMEMBERED_NS]
        if len(self._runs) >= _SOURCES_KEPT:
            self._runs.remove(min((run for run in self._runs if run is not self._ours), key=lambda run: run.heard_ns))
        run = _Run(t_ns, place, sequence)
        self._runs.append(run)
        return run

    def _elect(self, t_ns: int, run: _Run) -> None:
        """Make a run ours: the first one, one that goes on where ours ended, or one that comes after its silence."""
        ours = self._ours
        if ours is None:
            self._ours = run
        elif run is ours or run.count < _IN_A_ROW:
            return
        elif self._follows(t_ns, run, ours) or self._replaces(t_ns, run, ours):
            self._runs.remove(ours)
            self._ours = run
            self._between = self._between if run.place == ours.place else _Between()

    def _follows(self, t_ns: int, run: _Run, ours: _Run) -> bool:
        """Return whether a run began at the address of another when that had ended: by losses, or a restart.

        What fitted both was not of the one that ended when all that came since then was one run. In flight, where a
        third one speaks there, it must also tell by its boot time that it is ours: a loss ends the runs of both.
        """
        if run.place != ours.place:
            return False
        since, (count, lasting_ns) = self._unbroken.get(run.place), _ALONE_OF_ONE_BOOT
        one = since is not None and since.first_ns >= ours.heard_ns and since.count >= count
        alone = one and since is not None and t_ns - since.first_ns >= lasting_ns
        ended_ns = ours.heard_ns if alone else max(ours.heard_ns, ours.maybe_ns)
        ended = run.first_ns >= ended_ns and t_ns - ended_ns > max(_ENDED_NS, _ENDED_GAPS * ours.gap_ns)
        return ended and self._may_be_ours(t_ns, run, ours)

    def _may_be_ours(self, t_ns: int, run: _Run, ours: _Run) -> bool:
        """Return whether a run may be of our vehicle, started again or not; alone with the one that ended it may."""
        thirds = [third for third in self._runs if third not in (run, ours) and third.place == run.place]
        spoke = any(third.count >= _IN_A_ROW and t_ns - third.heard_ns <= REMEMBERED_NS for third in thirds)
        if not self.armed or ours.boot_ns is None or not spoke:
            return True
        return run.boot_ns is not None and (not ours.denies(t_ns, run.boot_ns) or run.boot_ns > ours.heard_ns)

    def _replaces(self, t_ns: int, run: _Run, ours: _Run) -> bool:
        if t_ns - ours.heard_ns <= _SILENCE_NS:
            return False
        return not self.armed or _same_boot(run, ours) or self._came_back(t_ns, run, ours)

    @staticmethod
    def _came_back(t_ns: int, run: _Run, ours: _Run) -> bool:
        """Return whether a run may be ours after it had lost its power while armed."""
        started_after = run.earliest_ns is not None and run.earliest_ns > ours.heard_ns
        return started_after and run.armed is False and t_ns - ours.heard_ns > _POWERLESS_NS


def _lasts(t_ns: int, run: _Run, limits: Tuple[int, int]) -> bool:
    return run.count >= limits[0] and t_ns - run.first_ns >= limits[1]


def _same_boot(run: _Run, ours: _Run) -> bool:
    return run.boot_ns is not None and ours.boot_ns is not None and abs(run.boot_ns - ours.boot_ns) <= _BOOT_NS


def _start(run: _Run, ours: _Run) -> str:
    """Say of who was started when ours was that it may be ours: a router that hears it by two of its ports."""
    return " (started when ours was: perhaps ours by a second port)" if _same_boot(run, ours) else ""


def _name(place: Any) -> str:
    if isinstance(place, tuple) and len(place) > 1:
        return f"{place[0]}:{place[1]}"
    return "the same line" if place is None else str(place)
