"""A switch of the pilot's transmitter that means land: is it on, and when is a landing asked for?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import FrozenSet, Optional

from amaze_autonomy.engine.events import UserCommand, UserRequest
from amaze_autonomy.engine.state import EngineState, State, Step

_S = 1_000_000_000
_AGAIN_NS = _S  # a request that came too late for its state is made again
_NAME = "the transmitter's land switch"
_IN_FLIGHT = (State.TAKEOFF, State.MISSION, State.HOLD)
_BEFORE_TAKEOFF = (State.START_RECORDING, State.LOAD_MISSION)


@dataclass(frozen=True)
class LandSwitchSpec:
    """A channel of the transmitter that means: land.

    Args:
        channel: from 1; 0: none does.
        above_us: width of the pulse above which it is on.
        hold_ns: how long it must be on; what the autopilot says of the transmitter after that decides.
        age_limit_ns: how old the last channels may be.
    """

    channel: int = 0
    above_us: float = 1700.0
    hold_ns: int = 700_000_000
    age_limit_ns: int = _S


class LandSwitchMonitor:
    """On for a while, by channels that are fresh, and then still of a transmitter that is heard; or it is not on.

    A receiver that has lost its transmitter may put every channel to any width at once; the autopilot notices later,
    and says so seldom. So a switch counts with the first report (SYS_STATUS) that would know of such a loss.

    Args:
        spec: which channel, and its limits.
    """

    def __init__(self, spec: LandSwitchSpec) -> None:
        self.spec = spec
        self._heard_ns: Optional[int] = None
        self._on_ns: Optional[int] = None
        self._reports = 0
        self._confirmed = False

    def add(self, t_ns: int, width_us: Optional[float], reports: int) -> None:
        """Take a message with the channels.

        Args:
            t_ns: when it came.
            width_us: pulse width of the channel; None, no pulse or no transmitter by the last report, says nothing.
            reports: how many reports on the transmitter came so far.
        """
        if width_us is None:
            return
        before_ns = t_ns if self._heard_ns is None else self._heard_ns  # what is reported anew came after that
        if t_ns - before_ns > self.spec.age_limit_ns:
            self._on_ns = None  # what it was before is nothing any more
        self._heard_ns = t_ns
        self._on_ns = None if width_us <= self.spec.above_us else t_ns if self._on_ns is None else self._on_ns
        reported, self._reports = reports != self._reports, reports
        held = self._on_ns is not None and before_ns - self._on_ns >= self.spec.hold_ns
        self._confirmed = held and (self._confirmed or reported)

    def on(self, t_ns: int) -> Optional[bool]:
        """Return whether it says: land; None: no fresh channels, or they may not be the transmitter's."""
        if self._heard_ns is None or t_ns - self._heard_ns > self.spec.age_limit_ns:
            return None
        if self._on_ns is None or self._heard_ns - self._on_ns < self.spec.hold_ns:
            return False
        return self._confirmed or None


class LandRequests:
    """Asks for a landing in the pilot's place while the switch of the transmitter says so; a held one asks again.

    It is a user's request as any other: nothing is taken over, and the engine says why it lands or does not.

    Args:
        without: missions that are flown without it, by their ids.
    """

    def __init__(self, without: FrozenSet[str]) -> None:
        self._without = without
        self._again_ns = 0

    def answer(self, state: EngineState, t_ns: int, *, on: bool) -> Optional[UserRequest]:
        """Return what is to be asked of the engine now; None: nothing."""
        mission = state.session.mission
        if not on or not _asks_in(state) or mission is None or mission.id in self._without:
            self._again_ns = 0
            return None
        if t_ns < self._again_ns:
            return None
        self._again_ns = t_ns + _AGAIN_NS
        return UserRequest(t_ns=t_ns, command=UserCommand.LAND, by=_NAME)


def _asks_in(state: EngineState) -> bool:
    """Return whether a switch that says land asks for it: in flight; behind the go, and between two files, too."""
    flies = state.flight.active and state.state in _IN_FLIGHT
    return flies or state.state in _BEFORE_TAKEOFF or state.step is Step.TOUCHDOWN
