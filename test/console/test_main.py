"""The whole console as a process: on a terminal, without one, at its end."""

from __future__ import annotations

import fcntl
import os
import re
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
from console_process import ConsoleProcess

from amaze_autonomy.console.main import main

pytestmark = pytest.mark.live

HERE = Path(__file__).parent
SCREEN_ON, SCREEN_OFF, CURSOR_ON = "\x1b[?1049h", "\x1b[?1049l", "\x1b[?25h"


def left_in_order(console):
    """Return True when the terminal is as it was: attributes, main screen, visible cursor, plain pasting."""
    ends = [console.seen.rindex(SCREEN_OFF) > console.seen.rindex(SCREEN_ON), console.seen.rindex(CURSOR_ON) > 0]
    return (
        all(ends)
        and console.seen.count("\x1b[?2004h") == console.seen.count("\x1b[?2004l")
        and (console.after() == console.before)
    )


# --- on a terminal ---


def test_land_is_one_key_and_one_more(tmp_path):
    with ConsoleProcess(tmp_path, "hold") as console:
        console.wait_for("waits 8 s (restart")
        console.type("l")
        console.wait_for("LAND at the present position?")
        assert console.asked() == []
        console.type("\r")
        console.wait_for("as asked")
        assert console.asked() == ["land"]


def test_a_mission_is_typed_and_confirmed(tmp_path):
    with ConsoleProcess(tmp_path, "mission-input") as console:
        console.wait_for("Short square, less than a minute")
        console.type("7\r")
        console.wait_for('There is no mission "7". There are: 1, 2, wall.')
        console.type("1\r")
        console.wait_for("Fly mission 1:")
        console.type("y")
        console.wait_for("mission 1:  DONE")
        assert console.asked() == ["mission 1"]


def test_pasted_text_does_not_land(tmp_path):
    with ConsoleProcess(tmp_path, "mission") as console:
        console.wait_for("close console only")
        console.type("\x1b[200~l\ry\x1b[201~")
        console.type("h")
        console.wait_for("as asked")
        assert console.asked() == ["hold"]


def test_ctrl_c_ends_the_console_and_nothing_else(tmp_path):
    with ConsoleProcess(tmp_path, "hold") as console:
        console.wait_for("close console only")
        console.type("\x03")
        assert console.end() == 130
        assert left_in_order(console)
        assert (
            "Interrupted. Console closed; that ends nothing else. The engine's last state: HOLD, IN FLIGHT."
            in console.seen
        )
        assert console.asked() == []


def test_quit_by_key(tmp_path):
    with ConsoleProcess(tmp_path, "ready") as console:
        console.wait_for("close console only")
        console.type("q")
        assert console.end() == 0
        assert left_in_order(console)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_other_signals_leave_the_terminal_in_order(tmp_path, number):
    with ConsoleProcess(tmp_path, "hold") as console:
        console.wait_for("close console only")
        console.signal(number)
        assert console.end() == 0
        assert left_in_order(console)


def test_a_defect_leaves_the_terminal_in_order_and_shows_its_traceback(tmp_path):
    with ConsoleProcess(tmp_path, "mission") as console:
        console.wait_for("close console only")
        console.type("a\r")
        assert console.end() == 1
        assert left_in_order(console)
        seen = re.sub(r"\x1b\[[0-9;]*m", "", console.seen)  # newer Pythons colour a traceback
        assert seen.index("ValueError: the console has a defect") > seen.rindex(SCREEN_OFF)


def test_a_window_that_is_closed_ends_the_console(tmp_path):
    with ConsoleProcess(tmp_path, "hold") as console:
        console.wait_for("close console only")
        console.hang_up()
        assert console.end() == 0


def test_ctrl_z_and_ctrl_s_do_not_stop_it(tmp_path):
    with ConsoleProcess(tmp_path, "mission") as console:
        console.wait_for("close console only")
        console.type("\x1a\x13\x1ch")
        console.wait_for("as asked")
        assert console.asked() == ["hold"]


def test_a_size_that_the_environment_tells_is_not_that_of_the_terminal(tmp_path):
    with ConsoleProcess(tmp_path, "alarm", "--ascii", LINES="60", COLUMNS="150") as console:
        console.wait_for("close console only")
        frame = re.sub(r"\x1b\[[0-?]*[ -/]*[@-~]", "", console.seen.split("\x1b[H")[-1]).splitlines()
        assert (len(frame), {len(line) for line in frame}) == (30, {100})
        assert any("TAKE OVER" in line for line in frame[:8])


def test_in_a_window_of_a_few_lines_the_question_of_a_landing_is_seen(tmp_path):
    with ConsoleProcess(tmp_path, "mission") as console:
        console.wait_for("close console only")
        fcntl.ioctl(console.terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 3, 80, 0, 0))
        console.signal(signal.SIGWINCH)
        console.type("l")
        console.wait_for("LAND at the present position?  Y or Enter = yes, any other key = no")


def test_silence_of_the_engine_is_loud(tmp_path):
    with ConsoleProcess(tmp_path, "hold", "--ascii") as console:
        console.wait_for("close console only")
        Path(f"{console.log}.silent").touch()
        console.wait_for("NO CONTACT")
        console.wait_for("The engine (autonomy) has been silent for 3 s.")


def test_ascii_where_the_locale_has_no_unicode(tmp_path):
    with ConsoleProcess(tmp_path, "hold", PYTHONIOENCODING="ascii") as console:
        console.wait_for("waits 8 s (restart")
        console.type("\x03")
        assert console.end() == 130
        assert console.seen.isascii()


def test_a_terminal_that_can_do_nothing_gets_lines(tmp_path):
    with ConsoleProcess(tmp_path, "hold", TERM="dumb") as console:
        console.wait_for("STATE     HOLD (holding), IN FLIGHT")
        console.type("l\n")
        console.wait_for("QUESTION  LAND at the present position?")
        console.type("y\n")
        console.wait_for("ANSWER    land: DONE as asked")
        console.type("\x03")
        assert console.end() == 130
        assert "\x1b" not in console.seen
        assert console.after() == console.before


def test_ctrl_s_holds_no_line_back_and_the_terminal_is_left_as_it_was(tmp_path):
    with ConsoleProcess(tmp_path, "mission", "--plain") as console:
        console.wait_for("COMMANDS")
        console.type("\x13")
        console.wait_for("waypoint 1 of 8")
        console.type("land\n")
        console.wait_for("ANSWER    land: DONE as asked")
        assert console.asked() == ["land"]
        console.type("\x03")
        assert console.end() == 130
        assert console.after() == console.before


def test_ctrl_s_holds_no_line_back_after_the_shell_has_had_the_terminal(tmp_path):
    with ConsoleProcess(tmp_path, "mission", "--plain") as console:
        console.wait_for("COMMANDS")
        console.signal(signal.SIGSTOP)
        termios.tcsetattr(console.inside, termios.TCSANOW, console.before)  # as it does for itself and for `fg`
        console.signal(signal.SIGCONT)
        console.wait_for("waypoint 2 of 8")
        assert not console.after()[0] & termios.IXON
        console.type("\x13land\n")
        console.wait_for("ANSWER    land: DONE as asked")


def test_a_picture_is_saved_for_each_state(tmp_path):
    with ConsoleProcess(tmp_path, "hold", "--pictures", str(tmp_path / "pictures")) as console:
        console.wait_for("close console only")
        console.type("\x03")
        assert console.end() == 130
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["01-hold.svg"]


def test_pictures_that_cannot_be_saved_are_said_and_do_not_end_it(tmp_path):
    (tmp_path / "file").touch()
    with ConsoleProcess(tmp_path, "hold", "--pictures", str(tmp_path / "file" / "below")) as console:
        console.wait_for("Pictures are not saved: Not a directory.")
        console.type("\x03")
        assert console.end() == 130


# --- without a terminal ---


def plain(tmp_path, scene, *arguments, stdin=subprocess.DEVNULL, **options):
    log = tmp_path / "asked"
    log.touch()
    process = subprocess.Popen(
        [sys.executable, str(HERE / "fake_engine.py"), str(log), scene, *arguments],
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        **options,
    )
    return process, log


def lines_until(process, words):
    """Return the lines up to the one that contains the words, without their time stamps."""
    lines = []
    for line in process.stdout:
        assert re.match(r"\d\d:\d\d:\d\d ", line), line
        lines.append(line[9:].rstrip())
        if words in line:
            return lines
    raise AssertionError("\n".join(lines))


def wait_until(is_so, what, limit_s=20.0):
    end_s = time.monotonic() + limit_s
    while not is_so():
        assert time.monotonic() < end_s, f"not in {limit_s} s: {what}"
        time.sleep(0.02)


def catches(process, number):
    """Return whether a process has a handler of its own for a signal: `SigCgt` of proc(5)."""
    status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
    return bool(int(re.search(r"SigCgt:\s*(\w+)", status)[1], 16) >> (number - 1) & 1)


def finish(process, number=signal.SIGINT):
    process.send_signal(number)
    out, _ = process.communicate(timeout=20)
    return process.returncode, out


def test_without_input_it_tells_and_never_blocks(tmp_path):
    process, log = plain(tmp_path, "land")
    lines = lines_until(process, "ADVICE")
    status, out = finish(process)
    assert re.fullmatch(r"START     console of autonomy, \d{4}-\d\d-\d\d, local time [+-]\d{4}", lines[0])
    assert lines[1:] == [
        "STATE     LAND (commanding), IN FLIGHT, mission 1 Short square, less than a minute, 1 min 57 s left",
        "ERROR     Landing: mission_camera: no message on /camera/image for longer than 0.3 s.",
        "FAULT     mission_camera code 16: land: no message on /camera/image for longer than 0.3 s",
        "PROGRESS  waypoint 0 of 8",
        "RECORDING recording",
        "ADVICE    Watch the vehicle; be ready to take over.",
    ]
    assert (status, log.read_text()) == (130, "")
    assert out.endswith(
        "END       Interrupted. Console closed; that ends nothing else. The engine's last state: LAND, IN FLIGHT.\n"
    )


def test_lines_of_a_pipe_wait_until_they_mean_something(tmp_path):
    process, log = plain(tmp_path, "mission-input", stdin=subprocess.PIPE)
    process.stdin.write("1\ny\n")
    process.stdin.flush()
    lines = lines_until(process, "ANSWER")
    status, _ = finish(process)
    assert lines[-2:] == [
        "QUESTION  Fly mission 1: Short square, less than a minute (42 s, battery needed 30 %)? "
        "Type y and Enter for yes, anything else for no.",
        "ANSWER    mission 1: DONE as asked",
    ]
    assert (status, log.read_text()) == (130, "mission 1\n")


def test_a_landing_is_sent_before_the_engine_was_heard_and_drops_what_waited_for_it(tmp_path):
    """Who asks for it does not want the mission any more that he typed before."""
    process, log = plain(tmp_path, "waiting-engine", stdin=subprocess.PIPE)
    process.stdin.write("1\n\x1b[2Jy\nland\n")
    process.stdin.flush()
    assert lines_until(process, "ANSWER")[1:] == ["INPUT     Not sent: 1, y.", "ANSWER    land: DONE as asked"]
    assert finish(process)[0] == 130
    assert log.read_text() == "land\n"


def test_a_landing_is_sent_to_an_engine_that_is_silent_and_a_takeoff_is_not(tmp_path):
    process, log = plain(tmp_path, "ready", stdin=subprocess.PIPE)
    lines_until(process, "COMMANDS")
    Path(f"{log}.silent").touch()
    lines_until(process, "CONTACT   LOST")
    for words, answer in (
        ("go", "INPUT     Not sent: go. No contact: only hold, land, abort are sent."),
        ("l", "QUESTION  LAND at the present position?"),
        ("y", "ANSWER    land: DONE as asked"),
        ("land", "ANSWER    land: DONE as asked"),
        ("hold", "ANSWER    hold: DONE as asked"),
    ):
        process.stdin.write(f"{words}\n")
        process.stdin.flush()
        lines_until(process, answer)
    assert finish(process)[0] == 130
    assert log.read_text() == "land\nland\nhold\n"


def test_a_mission_by_argument_is_selected_without_input(tmp_path):
    process, log = plain(tmp_path, "mission-input", "--mission", "2")
    lines_until(process, "ANSWER    mission 2: DONE as asked")
    assert finish(process, signal.SIGTERM)[0] == 0
    assert log.read_text() == "mission 2\n"


def test_an_end_of_input_does_not_end_the_console(tmp_path):
    process, log = plain(tmp_path, "hold", stdin=subprocess.PIPE)
    process.stdin.write("land")
    process.stdin.close()
    lines_until(process, "ANSWER    land: DONE as asked")
    process.stdin = None
    assert finish(process)[0] == 130
    assert log.read_text() == "land\n"


def test_quit_as_a_line_ends_it_even_without_an_engine(tmp_path):
    process, _ = plain(tmp_path, "waiting-engine", stdin=subprocess.PIPE)
    out, _ = process.communicate("quit\n", timeout=20)
    assert process.returncode == 0
    assert out.splitlines()[-1].endswith("END       Console closed.")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_once_is_not_done_when_it_is_ended_in_flight(tmp_path, number):
    process, _ = plain(tmp_path, "mission", "--once")
    lines_until(process, "STATE")
    assert finish(process, number)[0] == 3


def test_once_is_not_done_when_its_reader_goes_or_its_disk_is_full_in_flight(tmp_path):
    process, _ = plain(tmp_path, "mission", "--once")
    lines_until(process, "STATE")
    process.stdout.close()
    assert process.wait(20) == 3
    command = [sys.executable, str(HERE / "fake_engine.py"), str(tmp_path / "asked"), "mission", "--once"]
    with Path("/dev/full").open("w") as full:
        assert subprocess.run(command, check=False, stdin=subprocess.DEVNULL, stdout=full, timeout=20).returncode == 3


def test_once_with_a_wrong_mission_and_nobody_who_types_ends(tmp_path):
    process, log = plain(tmp_path, "mission-input", "--once", "--mission", "99")
    out, _ = process.communicate(timeout=20)
    assert (process.returncode, log.read_text()) == (2, "")
    assert 'END       There is no mission "99". There are: 1, 2, wall.' in out


def test_closed_input_and_a_reader_that_has_gone(tmp_path):
    process, _ = plain(tmp_path, "hold", preexec_fn=lambda: os.close(0))
    lines_until(process, "STATE")
    process.stdout.close()
    assert process.wait(20) == 0


@pytest.mark.parametrize("closed", [(1,), (1, 2), (0, 1, 2)])
def test_a_console_that_can_print_nowhere_works_and_ends_as_ever(tmp_path, closed):
    process, log = plain(tmp_path, "mission", stdin=subprocess.PIPE, preexec_fn=lambda: [os.close(n) for n in closed])
    if 0 not in closed:
        process.stdin.write("land\n")
        process.stdin.flush()
        wait_until(lambda: log.read_text() == "land\n", "what was typed")
    else:
        wait_until(lambda: catches(process, signal.SIGHUP), "a console that goes on")
    assert finish(process) == (130, "")


def test_no_engine_in_time_has_its_status(tmp_path):
    process, _ = plain(tmp_path, "waiting-engine", "--wait", "0.3")
    out, _ = process.communicate(timeout=20)
    assert process.returncode == 4
    assert out.splitlines()[-1].endswith("END       No engine on autonomy within 0.3 s.")


def test_a_terminal_that_belongs_to_others_gets_lines_and_is_read(tmp_path):
    """As under roslaunch: the terminal is there, but it is not the console's own."""
    outside, inside = os.openpty()
    before = termios.tcgetattr(inside)
    process, log = plain(tmp_path, "hold", stdin=inside, start_new_session=True)
    lines_until(process, "COMMANDS")
    assert [each[0] & termios.IXON > 0 for each in (before, termios.tcgetattr(inside))] == [True, False]
    os.write(outside, b"land\n")
    lines_until(process, "ANSWER    land: DONE as asked")
    assert finish(process)[0] == 130
    assert log.read_text() == "land\n"
    assert termios.tcgetattr(inside) == before
    os.close(outside)
    os.close(inside)


# --- the command line ---


def test_help_has_examples_and_exit_statuses(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    out = capsys.readouterr().out
    assert end.value.code == 0
    assert all(words in out for words in ("examples:", "exit status:", "--mission ID", "never touches the flight"))


def test_wrong_usage(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--fly"])
    assert end.value.code == 2
    assert "unrecognized arguments: --fly" in capsys.readouterr().err


def test_without_ros_it_says_what_to_do(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rospy", None)
    monkeypatch.delitem(sys.modules, "amaze_autonomy.console.ros_link", raising=False)
    assert main(["--plain"]) == 2
    assert re.fullmatch(
        r"console: ROS or the messages of amaze_autonomy are not there \(.*\): source devel/setup.bash\n",
        capsys.readouterr().err,
    )
