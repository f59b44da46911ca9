"""The autopilot node: what the vehicle says of itself, and the second route of a landing.

    autopilot/check           CheckAutopilot
    autopilot/check_battery   CheckBattery
    autopilot/land            std_srvs/Trigger; commands the landing mode, unless the pilot or a failsafe has control
    autopilot/disarm          std_srvs/Trigger; on the ground only
    autopilot/status          AutopilotStatus, 5 Hz and at once on a change
    autopilot/commanding      std_msgs/String, likewise: AUTO.LAND or DISARM while that stands here, else empty; the
                              planner then does nothing else
    autopilot/land_switch     std_msgs/Bool, likewise, where land_switch of autopilot.yaml has a channel: it says land
    /diagnostics              diagnostic_msgs/DiagnosticArray, 1 Hz
    landing_detection/landed  Landed: the range finder's opinion, for the check (subscribed)

The link, limits and needs: autopilot.yaml. Parameters: `node_main.py`. On SIGINT or SIGTERM in flight it commands the
landing mode before it closes its link, unless somebody else has control. The link itself: docs/autopilot.md.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Callable, Dict, Optional, Tuple

import rospy
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger, TriggerResponse

from amaze_autonomy import msg, srv
from amaze_autonomy.config import Configuration
from amaze_autonomy.engine.events import Landed
from amaze_autonomy.ros.clock import Clock

from ...autopilot.link.connection import link_problem
from ...autopilot.link.dialect import mavlink
from ...autopilot.vehicle.client import CLIENT_MESSAGES, AutopilotClient, Reply, switch_messages
from ...engine.events import Check
from ...ros.interface import CheckDiagnostics, check_row, number, status_message
from ...ros.node_main import run_node
from .vehicle_link import ChangeLog, LevelLoop, Link, make_link, tell_link

_S = 1_000_000_000
_QUEUE = 10
_GROUND_AGE_NS = _S
_LANDED = {int(state.value): state for state in Landed}
_WARNING, _ERROR = mavlink.MAV_SEVERITY_WARNING, mavlink.MAV_SEVERITY_ERROR


class AutopilotNode:
    """A client on a link, and the ROS names around it.

    Args:
        configuration: as loaded.
        clock: the node's.
    """

    def __init__(self, configuration: Configuration, clock: Clock) -> None:
        self._clock, self._settings = clock, configuration.autopilot
        self._ground: Optional[Tuple[int, Landed]] = None
        self.client = AutopilotClient(
            self._settings,
            configuration.battery,
            lambda: self._link.address,
            lambda: clock.ros_ns() - clock.now_ns(),
            lambda: self._link.state.strangers,
            configuration.rules.limits,
        )
        self.client.on_text = _log_text
        settings = self._settings
        messages = (*CLIENT_MESSAGES, *switch_messages(settings))
        self._link: Link = make_link(settings, settings.link, self.client, messages, clock)
        period_ns = round(_S / configuration.streams.autopilot_status_rate_hz)
        self._loop = LevelLoop(self._link, clock, period_ns, self._key, self._tell)
        self._publisher = rospy.Publisher("autopilot/status", msg.AutopilotStatus, queue_size=_QUEUE, tcp_nodelay=True)
        self._diagnostics = CheckDiagnostics("autopilot", clock)
        self._commanding = rospy.Publisher(
            "autopilot/commanding", String, queue_size=_QUEUE, tcp_nodelay=True, latch=True
        )
        self._switch = rospy.Publisher("autopilot/land_switch", Bool, queue_size=_QUEUE, tcp_nodelay=True)
        self._problem, self._said = "", ChangeLog()

    # --- services; on rospy's threads -----------------------------------------------------------------------------

    def _check(self, _request: Any) -> Any:
        ground = self._ground
        rows = self._link.ask(lambda t_ns: self.client.check(t_ns, _fresh(ground, t_ns)))
        checks = [check_row(row) for row in rows]
        return srv.CheckAutopilotResponse(ok=all(row.passed for row in rows), checks=checks)

    def _rows(self) -> Tuple[Check, ...]:
        ground = self._ground
        return self._link.ask(lambda t_ns: (self.client.rows(t_ns, _fresh(ground, t_ns)), ()))

    def _check_battery(self, request: Any) -> Any:
        needed = request.required_fraction
        verdict = self._link.ask(lambda t_ns: (self.client.check_battery(t_ns, needed), ()))
        return srv.CheckBatteryResponse(
            ok=verdict.ok,
            fraction=number(verdict.fraction),
            voltage=number(verdict.voltage_v),
            checks=[check_row(row) for row in verdict.checks],
        )

    def _land(self, _request: Any) -> Any:
        return self._answer("land", self.client.land, self.client.land_reply)

    def _disarm(self, _request: Any) -> Any:
        return self._answer("disarm", self.client.disarm, self.client.disarm_reply)

    def _answer(self, name: str, ask: Callable[[int], Any], reply: Callable[[], Reply]) -> Any:
        answer = self._settle(self._link.ask(ask), reply, self._settings.commands.reply_ns / _S)
        self._said.log(name, answer.message, warns=not answer.accepted)
        return TriggerResponse(success=answer.accepted, message=answer.message)

    def _settle(self, answer: Reply, reply: Callable[[], Reply], limit_s: float) -> Reply:
        """Wait until an answer is final, at most so long."""
        if answer.final:
            return answer
        self._link.wait_for(lambda: reply().final, limit_s)
        return reply()

    def _take_landed(self, message: Any) -> None:
        self._ground = (self._clock.now_ns(), _LANDED.get(message.landed, Landed.UNKNOWN))

    # --- the node's own thread ------------------------------------------------------------------------------------

    def run(self) -> None:
        """Publish until `end`; then land, where there is somebody in the air."""
        self._link.start()
        rospy.Subscriber("landing_detection/landed", msg.Landed, self._take_landed, queue_size=_QUEUE, tcp_nodelay=True)
        for name, kind, answer in (
            ("autopilot/check", srv.CheckAutopilot, self._check),
            ("autopilot/check_battery", srv.CheckBattery, self._check_battery),
            ("autopilot/land", Trigger, self._land),
            ("autopilot/disarm", Trigger, self._disarm),
        ):
            rospy.Service(name, kind, answer)
        try:
            self._loop.run()
        finally:
            self._leave()
            self._link.close()

    def _tell(self, now_ns: int) -> None:
        self._publish()
        self._diagnostics.publish(now_ns, self._rows())
        self._tell_link(now_ns)

    def _key(self, t_ns: int) -> Tuple[Any, ...]:
        """Return what is told at once when it changes."""
        vehicle = self.client.vehicle
        return (
            self.client.commanding,
            self.client.land_switch.on(t_ns),
            vehicle.told(t_ns),
            vehicle.landed(t_ns),
            vehicle.battery.critical,
            tuple(vehicle.health(t_ns).items()),
        )

    def _publish(self) -> None:
        self._commanding.publish(self._link.ask(lambda _: (self.client.commanding, ())))
        on = self._link.ask(lambda t_ns: (self.client.land_switch.on(t_ns), ()))
        if on is not None:
            self._switch.publish(on)
        status, health, measured, sequences = self._link.ask(lambda t_ns: (self._state(t_ns), ()))
        self._publisher.publish(status_message(status, self._clock.ros_ns(), health, measured, sequences))

    def _state(self, t_ns: int) -> Tuple[Any, Dict[str, Optional[bool]], Dict[str, Optional[float]], Dict[str, int]]:
        vehicle = self.client.vehicle
        health = {**vehicle.health(t_ns), "rc": vehicle.system.rc(t_ns), "prearm": vehicle.system.prearm(t_ns)}
        battery, offset_ns = vehicle.battery.reading(), vehicle.offset.utc_offset_ns
        measured = {
            "battery_cell_voltage": None if battery is None else battery.cell_voltage_v,
            "battery_current": None if battery is None else battery.current_a,
            "clock_offset": None if offset_ns is None else offset_ns / _S,
        }
        return self.client.status(t_ns), health, measured, vehicle.sequences(t_ns)

    def _tell_link(self, now_ns: int) -> None:
        """Log what has become of the link, once for each change."""
        problem = link_problem(self._link.state, now_ns)
        if problem != self._problem:
            self._problem = problem
            tell_link("autopilot", self._settings, self._settings.link, problem)

    def _leave(self) -> None:
        """Land before the link is closed, unless there is no reason to; say what came of it."""
        in_flight = self._link.ask(lambda t_ns: (self.client.vehicle.in_flight(t_ns), ()))
        if not in_flight:
            return
        limit_s = self._settings.commands.exit_limit_ns / _S
        leaving = self._link.ask(self.client.leave)
        with suppress(rospy.ROSException):  # the master has closed the topics
            self._publish()  # the planner must know that it lands
        answer = self._settle(leaving, self.client.land_reply, limit_s)
        print(f"autopilot: ended in flight: {answer.message}", flush=True)

    def end(self) -> None:
        """End; from any thread."""
        self._loop.end()


def _fresh(ground: Optional[Tuple[int, Landed]], t_ns: int) -> Optional[Landed]:
    return ground[1] if ground is not None and t_ns - ground[0] <= _GROUND_AGE_NS else None


def _log_text(severity: int, text: str) -> None:
    log = rospy.logerr if severity <= _ERROR else rospy.logwarn if severity <= _WARNING else rospy.loginfo
    log("vehicle: %s", text)


def main() -> int:
    """Run the node; return its exit status."""
    return run_node("autopilot", AutopilotNode)
