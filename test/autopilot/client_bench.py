"""An AutopilotClient and a simulated PX4 in virtual time, with a line between them that can lose packets."""

from __future__ import annotations

import random
import sys
from pathlib import Path

from amaze_autonomy.autopilot.link.connection import heartbeat
from amaze_autonomy.autopilot.link.peers import Identity, Peers
from amaze_autonomy.autopilot.link.wire import Wire
from amaze_autonomy.autopilot.vehicle.client import CLIENT_MESSAGES, AutopilotClient, switch_messages
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.monitoring.specs import BatterySpec

sys.path[:0] = [str(Path(__file__).parents[1] / "simulation" / "px4")]
from px4_tools import Bench, S  # noqa: E402

STEP = S // 50


class ClientBench:
    """Both, and the time.

    Args:
        lost: fraction of the packets that are lost each way.
        settings: of the client.
        kind: MAV_TYPE of the client's heartbeat.
        px4: settings of the simulated PX4.
    """

    def __init__(self, lost=0.0, settings=None, kind=18, **px4):
        self.far = Bench(kind=None, **px4)
        self.far.px4.connect("client")
        self.client = AutopilotClient(settings or AutopilotSettings(), BatterySpec(cells=4), lambda: (1, 1))
        self._peers, self._kind = Peers(Identity(1, 191)), kind
        self._wanted = (*CLIENT_MESSAGES, *switch_messages(self.client.settings))
        self._ours, self._theirs = Wire(1, 191, self._wanted), Wire(1, 1)
        self._noise, self._lost = random.Random(7), lost
        self.sent, self.cut, self.deaf = [], False, ()
        self._beat_ns = self._wake_ns = self._at = 0

    @property
    def vehicle(self):
        return self.client.vehicle

    @property
    def t_ns(self):
        return self.far.t_ns

    def transmit(self, messages):
        for message in messages:
            self.sent.append((self.t_ns, message))
            raw = self._ours.send(message)
            if not self.cut and self._noise.random() >= self._lost:
                for decoded in self._theirs.receive(raw):
                    self.far.px4.receive(self.t_ns, "client", decoded)

    def step(self):
        t_ns = self.t_ns + STEP
        self.far.step(t_ns)
        if t_ns >= self._beat_ns:
            self._beat_ns = t_ns + S
            self.transmit([heartbeat(self._kind)])
        heard, self._at = self.far.heard[self._at :], len(self.far.heard)
        for _, _, message in heard:
            if (
                message.get_type() not in self._wanted
                or message.get_type() in self.deaf
                or self.cut
                or self._noise.random() < self._lost
            ):
                continue
            for decoded in self._ours.receive(self._theirs.send(message)):
                if self._peers.take(t_ns, decoded):
                    self.transmit(self.client.receive(t_ns, decoded))
        if t_ns >= self._wake_ns:
            self._wake_ns = t_ns + 50_000_000
            self.transmit(self.client.wake(t_ns))

    def advance(self, seconds):
        end_ns = self.t_ns + round(seconds * S)
        while self.t_ns < end_ns:
            self.step()
        return self

    def until(self, condition, limit_s=60.0):
        end_ns = self.t_ns + round(limit_s * S)
        while not condition():
            assert self.t_ns < end_ns, f"not within {limit_s} s"
            self.step()
        return self

    def ask(self, question, *arguments):
        """Ask the client as the node does; return its answer."""
        answer, messages = question(self.t_ns, *arguments)
        self.transmit(messages)
        return answer

    def fly(self, up_m=5.0):
        """Take off by somebody else's hand, and hover."""
        self.far.kind = 6
        self.advance(3.0)
        self.far.take_off(up_m)
        return self.advance(2.0)

    def commands(self, number):
        """Return the times of the commands that were sent."""
        return [t_ns for t_ns, m in self.sent if m.get_type() == "COMMAND_LONG" and m.command == number]
