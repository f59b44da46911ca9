"""What the link would have said of a recorded flight: every change of the state with its time."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from amaze_autonomy.autopilot.link.framing import read_tlog
from amaze_autonomy.autopilot.link.peers import Identity, Peers
from amaze_autonomy.autopilot.link.wire import decode
from amaze_autonomy.autopilot.vehicle.vehicle import WANTED, VehicleState
from amaze_autonomy.config import AutopilotSettings

S = 1_000_000_000
DATA = Path(os.environ.get("AMAZE_DATA", Path(__file__).parents[3] / "shared" / "data"))


def recording(name):
    path = DATA / name
    if not path.is_file():
        pytest.skip(f"{path} is not there: set AMAZE_DATA to the folder of the recordings")
    return path


class Flight:
    """A recorded flight through VehicleState."""

    def __init__(self, name, settings=None):
        self.vehicle = VehicleState(settings or AutopilotSettings())
        self._peers = Peers(Identity(245, 191, 1))
        self._frames, self.counter = read_tlog(recording(name))
        self.start_ns = None

    def __iter__(self):
        """Yield the time in s after each message of the vehicle."""
        for t_ns, frame in self._frames:
            self.start_ns = self.start_ns or t_ns
            message = decode(frame)
            if message.get_type() not in WANTED:
                self._peers.pass_over(t_ns, (frame.system, frame.component), frame.sequence, None)
            elif self._peers.take(t_ns, message):
                self.vehicle.receive(t_ns, message)
                yield t_ns, (t_ns - self.start_ns) / S


def changes(name, value, settings=None):
    """Return [(s, value)] of each change of a function of (vehicle, t_ns)."""
    flight, said = Flight(name, settings), []
    for t_ns, t_s in flight:
        now = value(flight.vehicle, t_ns)
        if not said or said[-1][1] != now:
            said.append((round(t_s, 1), now))
    return said


def texts(name):
    flight, said = Flight(name), []
    for _ in flight:
        said += [text.text for text in flight.vehicle.texts.new]
        flight.vehicle.texts.new.clear()
    return said
