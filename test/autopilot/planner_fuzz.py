"""Damaged and hostile MAVLink into the planner's link, by a seed: no crash, nothing false, nothing sent but what may.

The vehicle of this fuzz stands on the ground, disarmed. It answers the mission protocol, but each item that it hands
out is another one than it was sent: so no file is ever loaded, and whatever is commanded, nothing takes off.
"""

from __future__ import annotations

from math import isfinite

from flying import LIMITS, MODEL, PLANS
from link_fuzz import NUMBERS, STATE, Fuzz
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot.link.framing import LONGEST
from amaze_autonomy.autopilot.link.peers import Identity, Peers
from amaze_autonomy.autopilot.link.wire import Wire
from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.autopilot.planner.sequencer import PLANNER_MESSAGES, Sequencer, SequencerSettings
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase
from amaze_autonomy.missions import PlannerSpec

OURS = [number for number in NUMBERS if mavlink.mavlink_map[number].msgname in PLANNER_MESSAGES]
NONSENSE = [number for number in OURS if mavlink.mavlink_map[number].msgname not in STATE]
CHANGES = (("command", 17), ("x", 7), ("y", -7), ("z", 0.5), ("param1", 3.0), ("frame", 2))
ANYWHERE = (0, 47 * 10**7, 91 * 10**7, 2**31 - 1, -(2**31))
QUIET = (MissionPhase.IDLE, MissionPhase.LANDED)


class PlannerFuzz(Fuzz):
    """A planner on a link without its socket."""

    ours, nonsenses = OURS, NONSENSE

    def __init__(self, seed):
        super().__init__(seed)
        self.client = Sequencer(SequencerSettings(PLANS, PlannerSpec(), MODEL, LIMITS))
        self.wire, self.peers = Wire(1, 192, PLANNER_MESSAGES), Peers(Identity(1, 192))
        self.asked, self.loads, self.read = [], 0, 0
        self._items = {}

    # --- what is fed ----------------------------------------------------------------------------------------------

    def good(self):
        """It stands there; somewhere, as its estimator says."""
        place = mavlink.MAVLink_global_position_int_message(
            0, self.chance.choice(ANYWHERE), self.chance.choice(ANYWHERE), 0, 0, 0, 0, 0, 0
        )
        estimate = mavlink.MAVLink_estimator_status_message(0, 0x1FF, *[0.1] * 8)
        return super().good() + self.vehicle.send(place) + self.vehicle.send(estimate)

    def piece(self):
        """Answer what was asked, or feed what the link's fuzz does."""
        if self.asked and self.chance.random() < 0.8:
            return self.vehicle.send(self._answer(self.asked.pop()))
        return super().piece()

    def _answer(self, message):
        kind = message.get_type()
        if kind == "MISSION_COUNT":
            return mavlink.MAVLink_mission_request_message(1, 192, self.chance.choice((0, 0, 0, message.count, 65535)))
        if kind == "MISSION_ITEM_INT":
            self._items[message.seq] = message
            return self.chance.choice((*[self._next] * 11, self._ack))(message)
        if kind == "MISSION_REQUEST_LIST":
            return mavlink.MAVLink_mission_count_message(
                1, 192, self.chance.choice((*[len(self._items)] * 4, 0, 65535))
            )
        if kind == "MISSION_REQUEST_INT" and message.seq in self._items:
            return self._changed(self._items[message.seq])
        return mavlink.MAVLink_mission_current_message(self.chance.choice((0, 3, 65535)))

    def _next(self, message):
        return mavlink.MAVLink_mission_request_int_message(1, 192, message.seq + 1)

    def _ack(self, _):
        return mavlink.MAVLink_mission_ack_message(1, 192, self.chance.choice((0, 0, 1, 15, 255)))

    def _changed(self, item):
        """Hand out an item that differs in one thing."""
        self.read += 1
        fields = {name: getattr(item, name) for name in item.fieldnames}
        name, value = self.chance.choice(CHANGES)
        fields[name] = value if name in ("command", "frame") else max(-(2**31), min(2**31 - 1, fields[name] + value))
        if fields[name] == getattr(item, name):
            fields["command"] = 17
        return mavlink.MAVLink_mission_item_int_message(*fields.values())

    # --- what comes of it -----------------------------------------------------------------------------------------

    def step(self):
        """Feed one piece, ask for something, look at all that is said and sent."""
        data, source = self.piece(), self.chance.choice(("a", "b", self.chance.randrange(10_000)))
        self.t_ns += self.chance.randrange(20_000_000)
        sent = []
        for frame, message in self.wire.each(data, source, self.t_ns):
            if message is None:
                self.peers.pass_over(self.t_ns, (frame.system, frame.component), frame.sequence, None)
            elif self.peers.take(self.t_ns, message):
                self.heard += 1
                sent += self.client.receive(self.t_ns, message)
        sent += self.client.wake(self.t_ns)
        sent += self._order() if self.chance.random() < 0.01 else ()
        self._send(sent)
        self.look(self.t_ns)
        assert self.wire.kept <= 16 * LONGEST

    def _order(self):
        if self.chance.random() < 0.5:
            loading, messages = self.client.load(self.t_ns, LoadRequest("s", "line", 0, 0))
            self.loads += not loading.refused
            self.asked.clear()
            self._items.clear()
            return messages
        action = self.chance.choice(list(MissionAction))
        refused, messages = self.client.command(self.t_ns, "s", action)
        assert refused or action in (MissionAction.LAND, MissionAction.ABORT)
        return messages

    def _send(self, messages):
        assert len(messages) <= 64
        for message in messages:
            assert self.wire.send(message, self.t_ns)  # it can be packed
            kind = message.get_type()
            assert kind != "SET_POSITION_TARGET_LOCAL_NED"
            if kind == "COMMAND_LONG":
                disarms = (message.command, message.param1) == (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
                mode = (message.command, message.param2, message.param3)
                lands = mode == (mavlink.MAV_CMD_DO_SET_MODE, 4.0, 6.0)  # as it was told to, where it is said to fly
                assert disarms or lands or message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message
            if kind.startswith("MISSION_"):
                self.asked = [*self.asked[-5:], message]

    def look(self, t_ns):
        """Assert that nothing false is said."""
        status = self.client.status(t_ns)
        assert status.phase in QUIET, status
        assert 0 <= status.waypoint <= status.waypoints
        assert all(value is None or isfinite(value) for value in (status.distance_left_m, status.time_left_s))
        assert "\n" not in status.message
        assert not self.client.watch.armed
