"""Drives the machines of the recorder in a time of its own, and plays processes, files and platforms."""

from __future__ import annotations

import json

from amaze_autonomy.engine.events import RecordingPhase
from amaze_autonomy.recording import (
    Answer,
    Collector,
    CollectorSetup,
    GroupSetup,
    GroupStatus,
    PlatformRecorder,
    PlatformSetup,
    PlatformStatus,
    ProcessStatus,
    Status,
)
from amaze_autonomy.recording.collector import Offset
from amaze_autonomy.recording.status import Ask, MeasureClock, Recover, Signal, Space, StartChild

S = 1_000_000_000
MS = 1_000_000
GB = 1_000_000_000
EPOCH_NS = 1_800_000_000 * S  # from the machine's time to what messages are stamped with
PHASE = RecordingPhase


class Platform:
    """A platform's machine with simulated recorders: they start, grow and end as they are told."""

    def __init__(self, groups=("states", "cameras"), free=100 * GB, step_ns=100 * MS):
        setup = PlatformSetup("main", tuple(GroupSetup(name, (f"/{name}",)) for name in groups), reserve_bytes=GB // 5)
        self.machine = PlatformRecorder(setup)
        self.now_ns, self.step_ns, self.free = 0, step_ns, free
        self.running = dict.fromkeys(groups, False)
        self.sizes = dict.fromkeys(groups, 0)
        self.grows = dict.fromkeys(groups, 100_000)
        self.endings = dict.fromkeys(groups, "")
        self.missing = dict.fromkeys(groups, ())
        self.silent = dict.fromkeys(groups, False)
        self.full = dict.fromkeys(groups, False)
        self.removed = dict.fromkeys(groups, False)
        self.halted = dict.fromkeys(groups, False)
        self.dropped = dict.fromkeys(groups, 0)
        self.numbers = dict.fromkeys(groups, 0)  # of the last file that lies in the folder of the session
        self.idle = dict.fromkeys(groups, None)
        self.obeys = dict.fromkeys(groups, ("INT", "TERM", "KILL", "CONT"))
        self.commands = []
        self.phases = [PHASE.IDLE]

    def turn(self):
        self.now_ns += self.step_ns
        for name, runs in self.running.items():
            self.sizes[name] += self.grows[name] if runs and not self.halted[name] else 0
        groups, space = (
            {name: self.processes(name) for name in self.running},
            Space(self.free, self.free / (256 * GB)),
        )
        processes = ProcessStatus(groups, space, self.now_ns + EPOCH_NS)
        for command in self.machine.step(self.now_ns, processes):
            self.commands.append(command)
            self.carry_out(command)
        if self.machine.phase is not self.phases[-1]:
            self.phases.append(self.machine.phase)

    def processes(self, name):
        return GroupStatus(
            running=self.running[name],
            ending=self.endings[name],
            size=self.sizes[name],
            idle_ns=self.idle[name],
            missing=self.missing[name],
            silent=self.silent[name],
            dropped=self.dropped[name],
            full=self.full[name],
            removed=self.removed[name],
            halted=self.halted[name],
            number=self.numbers[name],
        )

    def carry_out(self, command):
        if isinstance(command, StartChild):
            self.running[command.group], self.endings[command.group] = True, ""
            self.removed[command.group] = False
            assert command.number > self.numbers[command.group], "nothing is written over a file"
            self.numbers[command.group] = command.number
        elif isinstance(command, Signal) and command.name == "CONT":
            self.halted[command.group] = self.halted[command.group] and "CONT" not in self.obeys[command.group]
        elif isinstance(command, Signal) and command.name in self.obeys[command.group]:
            self.running[command.group] = False

    def go_on(self, seconds):
        for _ in range(round(seconds * S / self.step_ns)):
            self.turn()
        return self

    def start(self, session="s1", mission="m", problem=""):
        return self.machine.start(self.now_ns, session, mission, problem)

    def stop(self, session="s1"):
        return self.machine.stop(self.now_ns, session)

    def kill(self, name, ending="killed by SIGKILL"):
        self.running[name], self.endings[name] = False, ending

    @property
    def part(self):
        return self.machine.status(self.now_ns).platforms[0]

    def asked(self, kind):
        return [command for command in self.commands if isinstance(command, kind)]


def recording(**options):
    """Return a platform that records."""
    platform = Platform(**options)
    assert platform.start() == Answer(accepted=True)
    return platform.go_on(1.0)


class Fleet:
    """A collector and what it hears of its platforms; they obey unless they are told otherwise."""

    def __init__(self, platforms=("main", "second"), step_ns=100 * MS, **setup):
        self.collector = Collector(CollectorSetup("main", platforms, fetched=platforms[1:], **setup))
        self.now_ns, self.step_ns = 0, step_ns
        self.said = {name: Status(platforms=(PlatformStatus(name),)) for name in platforms}
        self.silent = dict.fromkeys(platforms, False)
        self.refuses = dict.fromkeys(platforms, "")
        self.measures = True
        self.commands = []
        self.phases = [PHASE.IDLE]

    def say(self, name, phase, session="s1", message="", growing=None):
        grows = phase is PHASE.RECORDING if growing is None else growing
        part = PlatformStatus(name, grows, 1000, 10.0, 0.5, f"/rec/{name}", message)
        self.said[name] = Status(session, phase, None, None, (part,), f"/rec/{name}", message)

    def turn(self):
        self.now_ns += self.step_ns
        for name, status in self.said.items():
            if not self.silent[name]:
                self.collector.heard(self.now_ns, name, status)
        for command in self.collector.step(self.now_ns):
            self.commands.append(command)
            if isinstance(command, Ask):
                self.answer(command)
            elif isinstance(command, MeasureClock) and self.measures:
                self.collector.clock_measured(command.platform, command.when, Offset(0, 1, self.now_ns))
        if self.collector.phase is not self.phases[-1]:
            self.phases.append(self.collector.phase)

    def answer(self, command):
        name, session = command.platform, command.session_id or self.collector.session_id
        if self.silent[name]:
            self.collector.unanswered(name, "no such service")
            return
        if self.refuses[name]:
            self.collector.answered(name, command.verb, session, Answer(False, self.refuses[name]))
            return
        self.collector.answered(name, command.verb, session, Answer(True))
        self.say(name, {"start": PHASE.RECORDING, "stop": PHASE.COMPLETE}.get(command.verb, PHASE.COMPLETE), session)

    def go_on(self, seconds):
        for _ in range(round(seconds * S / self.step_ns)):
            self.turn()
        return self

    def start(self, session="s1", mission="m"):
        return self.collector.start(self.now_ns, session, mission)

    def stop(self, session="s1"):
        return self.collector.stop(self.now_ns, session)

    @property
    def status(self):
        return self.collector.status(self.now_ns)

    def asked(self, kind):
        return [command for command in self.commands if isinstance(command, kind)]


def stopped(platform, session="s1"):
    """Return a platform that has closed the part of a session."""
    assert platform.stop(session) == Answer(accepted=True)
    return recovered(platform.go_on(0.3))


def recovered(platform, problem=""):
    """Let the recovery that was asked for end."""
    assert platform.asked(Recover)
    platform.machine.recovery_ended(platform.now_ns, problem)
    return platform.go_on(0.1)


def recorded_memory(platform):
    """Return the memory of a machine as it comes back from a file."""
    return json.loads(json.dumps(platform.machine.memory()))
