"""Restarting a component that failed: when to ask for it, and when to give up.

```
            failed                 asked for              back
  IDLE ---------------> PAUSE ------------> ATTEMPT ------------> IDLE  (good samples; an exit status proves nothing)
                          ^   backoff_ns       |
                          +--------------------+  attempt_limit_ns passed, or it was told that the attempt failed
                          |                    |
                          +----> GIVEN_UP <----+  attempts used up, or total_limit_ns spent failing
```

When it will give up is an estimate for the time left that a person is shown; no decision rests on it. An attempt is
expected to take its limit, and once one has failed sooner, as long as that one.

It asks and does not act: a request is handed to the shell, which says how it ended. Attempts and time spent are
forgotten when the component was good for `forget_after_ns`, or by a new take-off check (`forget`). Components of the
PX4 are refused here too, whatever the specification says.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Mapping, Optional, Tuple

from ..engine.rules import Restart
from .condition import FOREVER_NS
from .errors import RestartRefusedError
from .specs import ComponentSpec, RestartPolicy

_LATE_NS = 500_000_000
"""No two attempts take the same time: one that is later than this is expected to take its whole limit."""


_OURS = (
    "autonomy",
    "autopilot",
    "cns_peers",
    "cns_server",
    "landing_detection",
    "mavlink_router",
    "mission_planner",
    "node_group",
    "state_estimation",
    "watchdog",
)
_OUR_RECORDERS = "data_recorder"  # one on each platform: data_recorder_main


def why_kept(node: str, of_the_px4: Mapping[str, str], link: str = "") -> str:
    """Return why a node is never ended, whoever would have it restarted; empty: it may be.

    Args:
        node: its name.
        of_the_px4: nodes of components of the PX4, and the names of these.
        link: the node through which the vehicle is reached; empty: none but ours.
    """
    own = node.rpartition("/")[2]
    if node in of_the_px4:
        return f"{node} is a node of {of_the_px4[node]}, of the PX4"
    if link and node == link.rstrip("/"):
        return f"{node} is mavros, the link to the vehicle"
    return f"{node} is a node of this stack" if own in _OURS or own.startswith(_OUR_RECORDERS) else ""


@dataclass(frozen=True)
class RestartRequest:
    """What the shell is asked to do, once.

    Args:
        component: name of the component.
        attempt: number of the attempt, from 1.
        policy: how.
        node: node to be killed, for NODE.
        command: program and arguments, for DRIVER and COMMAND; no shell.
        limit_ns: time that it may take.
    """

    component: str
    attempt: int
    policy: RestartPolicy
    node: str
    command: Tuple[str, ...]
    limit_ns: int


class _Phase(enum.Enum):
    IDLE = "idle"
    PAUSE = "pause"
    ATTEMPT = "attempt"
    GIVEN_UP = "given up"


class RestartMachine:
    """The restarts of one component.

    Raises:
        RestartRefusedError: the component belongs to the PX4 and has a restart.
    """

    def __init__(self, spec: ComponentSpec) -> None:
        if spec.group == "px4" and spec.restart.policy is not RestartPolicy.NEVER:
            raise RestartRefusedError(spec.name)
        self.spec = spec
        self._limits = spec.restart
        self._phase = _Phase.IDLE
        self._failed_since_ns: Optional[int] = None
        self._good_since_ns: Optional[int] = None
        self._phase_ends_ns = 0
        self._spent_ns = 0
        self._attempts = 0
        self._attempt_takes_ns = spec.restart.attempt_limit_ns

    @property
    def possible(self) -> bool:
        """True when the component may be restarted at all."""
        return self._limits.policy is not RestartPolicy.NEVER

    @property
    def restart(self) -> Restart:
        """What is done about the component, as on the wire."""
        if self._phase is _Phase.IDLE:
            return Restart.NONE
        return Restart.GIVEN_UP if self._phase is _Phase.GIVEN_UP else Restart.TRYING

    @property
    def until_ns(self) -> Optional[int]:
        """When it gives up if nothing helps; None when it does not try."""
        if self._phase is _Phase.PAUSE:
            return min(self._give_up_ns, self._phase_ends_ns + self._attempts_take_ns)
        if self._phase is _Phase.ATTEMPT:
            pause_ns = self._limits.backoff_ns if self._attempts < self._limits.attempts else 0
            return min(self._give_up_ns, self._attempt_ends_ns + pause_ns + self._attempts_take_ns)
        return None

    @property
    def changes_at_ns(self) -> int:
        """When something changes here if nothing else happens."""
        if self._phase in (_Phase.PAUSE, _Phase.ATTEMPT):
            ends_ns = self._attempt_overdue_ns if self._phase is _Phase.ATTEMPT else self._phase_ends_ns
            return min(ends_ns, self._give_up_ns)
        return FOREVER_NS

    def forget(self) -> None:
        """Forget attempts and time spent: a new take-off check tries anew. Does nothing while it tries."""
        if self._phase in (_Phase.IDLE, _Phase.GIVEN_UP):
            self._phase, self._failed_since_ns = _Phase.IDLE, None
            self._attempts = self._spent_ns = 0

    def update(self, t_ns: int, *, failed: bool) -> Optional[RestartRequest]:
        """Say whether the component has failed at a time. Return what is to be done now, if anything."""
        if not self.possible:
            return None
        if not failed:
            self._recover(t_ns)
            return None
        if self._failed_since_ns is None:
            self._fail(t_ns)
        self._not_after(t_ns)
        if self._phase in (_Phase.PAUSE, _Phase.ATTEMPT) and t_ns >= self._give_up_ns:
            self._phase = _Phase.GIVEN_UP
        if self._phase is _Phase.ATTEMPT and t_ns >= self._phase_ends_ns:
            self._end_attempt(self._phase_ends_ns)
        if self._phase is _Phase.ATTEMPT and t_ns >= self._attempt_overdue_ns:
            self._attempt_takes_ns = self._limits.attempt_limit_ns
        if self._phase is _Phase.PAUSE and t_ns >= self._phase_ends_ns:
            return self._ask(t_ns)
        return None

    def tell(self, t_ns: int, attempt: int, *, good: bool) -> None:
        """Say how an attempt ended. Good is not back: samples show that. Any attempt but the present is ignored."""
        if self._phase is _Phase.ATTEMPT and attempt == self._attempts and not good:
            self._end_attempt(t_ns)

    @property
    def _give_up_ns(self) -> int:
        return (self._failed_since_ns or 0) + self._limits.total_limit_ns - self._spent_ns

    @property
    def _attempt_began_ns(self) -> int:
        return self._phase_ends_ns - self._limits.attempt_limit_ns

    @property
    def _attempt_ends_ns(self) -> int:
        return self._attempt_began_ns + self._attempt_takes_ns

    @property
    def _attempt_overdue_ns(self) -> int:
        return min(self._phase_ends_ns, self._attempt_ends_ns + _LATE_NS)

    @property
    def _attempts_take_ns(self) -> int:
        """Time that the attempts that are left are expected to take, with the pauses between them."""
        left = self._limits.attempts - self._attempts
        return left * self._attempt_takes_ns + max(0, left - 1) * self._limits.backoff_ns

    def _fail(self, t_ns: int) -> None:
        if self._good_since_ns is not None and t_ns - self._good_since_ns >= self._limits.forget_after_ns:
            self._attempts = self._spent_ns = 0
        self._failed_since_ns = t_ns
        used_up = self._attempts >= self._limits.attempts or self._spent_ns >= self._limits.total_limit_ns
        self._phase = _Phase.GIVEN_UP if used_up else _Phase.PAUSE
        self._phase_ends_ns = t_ns + (self._limits.backoff_ns if self._attempts else 0)

    def _recover(self, t_ns: int) -> None:
        if self._failed_since_ns is not None:
            self._spent_ns += max(0, t_ns - self._failed_since_ns)
            self._failed_since_ns, self._good_since_ns = None, t_ns
        self._phase = _Phase.IDLE

    def _end_attempt(self, t_ns: int) -> None:
        took_ns = t_ns - self._attempt_began_ns
        self._attempt_takes_ns = took_ns if self._attempts == 1 else max(self._attempt_takes_ns, took_ns)
        if self._attempts >= self._limits.attempts:
            self._phase = _Phase.GIVEN_UP
        else:
            self._phase, self._phase_ends_ns = _Phase.PAUSE, t_ns + self._limits.backoff_ns

    def _ask(self, t_ns: int) -> RestartRequest:
        self._attempts += 1
        self._phase, self._phase_ends_ns = _Phase.ATTEMPT, t_ns + self._limits.attempt_limit_ns
        limits = self._limits
        node = (self.spec.node or "") if limits.policy is RestartPolicy.NODE else ""
        return RestartRequest(
            self.spec.name, self._attempts, limits.policy, node, limits.command, limits.attempt_limit_ns
        )

    def _not_after(self, t_ns: int) -> None:
        """Keep every wait bounded when time has jumped backwards."""
        if self._failed_since_ns is not None:
            self._failed_since_ns = min(self._failed_since_ns, t_ns)
        longest = self._limits.attempt_limit_ns if self._phase is _Phase.ATTEMPT else self._limits.backoff_ns
        self._phase_ends_ns = min(self._phase_ends_ns, t_ns + longest)
