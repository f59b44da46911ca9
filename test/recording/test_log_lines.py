"""What rosbag's recorder says of itself: the lines are those of the real one."""

import pytest

from amaze_autonomy.recording.programs import LogState, read_line

FULL = "Less than 200M of space free on disk with '/rec/x.bag.active'. Disabling recording."
WRITING = "what():  Error writing to file: writing 4096"
DROPPED = "\x1b[33m[ WARN] [1795234653.1]: rosbag record buffer exceeded.  Dropping oldest queued message.\x1b[0m"


@pytest.mark.parametrize(
    "line, state",
    [
        (DROPPED, LogState(dropped=1)),
        (f"[ERROR] [1.5]: {FULL}", LogState(full=True, error=f"[ERROR] [1.5]: {FULL}")),
        ("[ WARN] [1.5]: Less than 5 x 200M of space free on disk with '/rec/x.bag.active'.", LogState()),
        ("[ INFO] [1.5]: Subscribing to /imu", LogState()),
        (f"  {WRITING}", LogState(full=True, error=WRITING)),
        ("[FATAL] [1.5]: cannot", LogState(error="[FATAL] [1.5]: cannot")),
    ],
)  # fmt: skip
def test_a_line_is_understood(line, state):
    assert read_line(LogState(), line) == state


def test_warnings_add_up():
    state = LogState()
    for line in (DROPPED, "anything", DROPPED):
        state = read_line(state, line)
    assert state == LogState(dropped=2)
