"""The simulated world: one vehicle, its sensors, and the engine's peers.

Pure: no ROS, no clock, no threads; only `scenario_file.py` and `cli.py` touch files. `world.py` puts `vehicle/`,
`sensors.py` and `peers/` together, `scenario.py` and `faults.py` are what goes wrong; `px4/` and `ardupilot/` are the
vehicle as it is met over MAVLink.

Samples, processes, replies, armed, landed, height and battery are the source. Conditions, codes and verdicts follow
from them by the very code of `monitoring/`, and faults act on the source. The same seed, scenario and commands give the
same events, to the bit.

Offline, in virtual time (`run.py` closes the loop with the engine)::

    world = World(configuration, seed=1, faults=scenario)
    world.handle(t_ns, command)            # a command of the engine
    world.next_ns                          # when something happens next
    for event in world.advance(t_ns): ...  # all events up to a time, in order
    world.observe_state(t_ns, "OUTREACH")  # the engine's state, for scenarios that wait for it

Live, behind ROS services and topics, with the node's clock and ``live=True``. The seam, for the node:

* ``advance(now)`` at least every 10 ms, or at ``next_ns`` and at once after ``handle``. Each event that has a
  ``command_id`` (`Reply`, `CheckReply`) is the answer to a request; each `UserRequest` is what the scenario's user asks
  of the engine (call that service of the engine); every other event is a status, to be published on its peer's topic.
  What is not in a status event is in ``sensor_health()`` (the PX4 sensors, for `AutopilotStatus`).
* A service handler makes the engine's command with an id of its own, calls ``handle(now, command)``, and waits for the
  event with that `command_id`. A service that hangs never answers: the handler waits until the node shuts down. The
  outcome BROKEN means: raise in the handler, so that the caller sees the call die. ``services()`` says which services
  are there now: take away and bring back the others.
* ``samples()`` returns what the sensors sent since the last call: topic, ROS type, stamp, and the fields of the message
  as plain values (`sensors.py`); the node only converts. ``processes()`` says which nodes live.
* ``observe_state(now, state)`` when the engine publishes another state.
* ``without=("mission_planner",)`` leaves a peer out: a real node takes its place.
* Times are the node's clock, in nanoseconds; ``start_ns`` is the time of the first call.

Nothing here is safe for threads: one lock around the world, held for microseconds.
"""

from __future__ import annotations

from .errors import NoEffectError, SimulatedTimeError, SimulationError, UnknownTargetError
from .scenario import EVENTS, KINDS, Fault, FaultKind, Request, Scenario, Subject, Trigger
from .scenario_file import load_scenario, parse_scenario
from .settings import Settings
from .world import World

__all__ = [
    "EVENTS",
    "KINDS",
    "Fault",
    "FaultKind",
    "NoEffectError",
    "Request",
    "Scenario",
    "Settings",
    "SimulatedTimeError",
    "SimulationError",
    "Subject",
    "Trigger",
    "UnknownTargetError",
    "World",
    "load_scenario",
    "parse_scenario",
]
