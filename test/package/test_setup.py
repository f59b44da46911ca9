"""The set-up of `./run`: interrupted, repeated, by a user with sudo, after a pull, moved; in a path with a space.

What takes minutes is stood in for: it does half of its work, then the rest; between them is a moment to end everything.
"""

from __future__ import annotations

import fcntl
import os
import random
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.builds
NOBODY = 65534
DONE = "installed", "folder/.venv", "folder/build/devel"  # what a set-up leaves

STAND_IN = """#!/bin/bash
# Whatever program it is called as; $WORLD is its memory.
name=${0##*/}
echo "$name $*" >>"$WORLD/log"
moment() { # the drawn one ends whoever has started all this, and this program
    echo x >>"$WORLD/moments"
    [ "$(wc -l <"$WORLD/moments")" != "${END_AT:-}" ] || kill -s "$END_BY" 0
}
case $name in
    apt-get)
        case " $* " in *" --simulate "* | *" --assume-no "*) exit ;; esac
        [ "$(id -u)" = 0 ] || [ -n "$BY_SUDO" ] || { echo "are you root?"; exit 100; }
        if [[ " $* " == *" install "* ]]; then
            [ ! -e "$WORLD/dpkg" ] || { echo "dpkg was interrupted, you must run 'dpkg --configure -a'"; exit 100; }
            touch "$WORLD/dpkg"
            moment
            rm "$WORLD/dpkg"
            printf '%s\\n' "$@" | grep -v -e '^-' -e '^install$' -e '^DPkg' >>"$WORLD/installed"
        else
            moment
        fi ;;
    apt-cache) echo "$2 | 1.0" ;;
    dpkg) rm -f "$WORLD/dpkg" ;;
    dpkg-query) sed 's/$/ installed/' "$WORLD/installed" ;;
    sudo) [ -z "${REFUSED:-}" ] && BY_SUDO=1 exec "$@" ;;
    python3)
        case $1 in
            --version) echo "Python 3.11.2" ;;
            -m)
                for folder; do :; done
                rm -rf "$folder"
                mkdir -p "$folder/bin"
                moment
                mkdir -p "$folder/lib/python3.11/site-packages"
                for program in pip python3; do ln -s "$WORLD/programs/$program" "$folder/bin/$program"; done ;;
            *) moment; exec /usr/bin/python3 "$@" ;;
        esac ;;
    pip) # it takes a package for installed that has the folder of what is told of it
        trap 'exit 1' INT
        for package; do :; done
        [ "$package" != "${OFFLINE:-}" ] || exit 1
        [ -z "${OFFLINE:-}" ] || ! grep -q newer pyproject.toml || exit 1
        told=$(dirname "$(dirname "$0")")/lib/python3.11/site-packages/${package//[^a-z]/_}.dist-info
        [ ! -d "$told" ] || exit 0
        mkdir "$told"
        moment
        echo pip >"$told/INSTALLER" ;;
    cmake)
        if [ "$1" = -S ]; then
            mkdir -p build/devel
            moment
            echo "echo" >build/devel/setup.bash
        elif [ ! -e build/devel/messages ]; then
            echo half >build/devel/messages
            moment
            sha256sum <msg/Told.msg >build/devel/messages
        fi ;;
esac
"""


class World:
    """A checkout, whose programs are stood in for, in a folder that any user may enter."""

    def __init__(self, folder: Path) -> None:
        self.path = folder
        self.checkout = folder / "folder"
        for name in ("msg", "srv", "scripts"):
            (self.checkout / name).mkdir(parents=True)
            (self.checkout / name / "Told.msg").write_text("bool told\n")
        for name in ("CMakeLists.txt", "setup.py", "package.xml"):
            shutil.copy(ROOT / name, self.checkout)
        (self.checkout / "pyproject.toml").write_text("requires numpy\n[tool.ruff]\n")
        programs = folder / "programs"
        programs.mkdir()
        (programs / "stand_in").write_text(STAND_IN)
        (programs / "stand_in").chmod(0o755)
        for name in ("apt-get", "apt-cache", "dpkg", "dpkg-query", "sudo", "python3", "pip", "cmake"):
            (programs / name).symlink_to("stand_in")
        text = (ROOT / "run").read_text()
        assert "environment /usr/bin/python3" in text
        text = text.replace("/usr/bin/python3", f"'{programs}/python3'")
        for place in ("/usr/lib/*/cmake/rostest", "/usr/share/rostest"):
            assert f" {place}" in text
            text = text.replace(f" {place}", f" '{folder}'{place}")
        (self.checkout / "run").write_text(text)
        for name in ("installed", "log", "moments"):
            (folder / name).touch()

    def run(self, *arguments: str, user: int | None = None, **variables: str) -> subprocess.CompletedProcess:
        """Set up, in a process group of its own; as another user, where we are root."""
        (self.path / "log").write_text("")
        (self.path / "moments").write_text("")
        become = []
        if user is not None and os.geteuid() == 0:
            for path in (self.path, *self.path.rglob("*")):
                os.chown(path, user, user, follow_symlinks=False)
            become = ["setpriv", f"--reuid={user}", f"--regid={user}", "--clear-groups"]
        own = {"WORLD": str(self.path), "BY_SUDO": "", "PATH": f"{self.path}/programs:{os.environ['PATH']}"}
        return subprocess.run(
            [*become, "env", "--default-signal=INT", "bash", str(self.checkout / "run"), *(arguments or ("install",))],
            cwd=self.path,
            env={**os.environ, **own, **variables},
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
            start_new_session=True,
            stdin=subprocess.DEVNULL,
        )

    def done(self) -> list[str]:
        """What was done, and not only asked, by program and first argument."""
        words = [line.split()[:2] for line in (self.path / "log").read_text().splitlines()]
        asked = ("apt-cache", "dpkg-query", "sudo")
        return [" ".join(each) for each in words if each[0] not in asked and each[1:] != ["--version"]]

    def left(self) -> dict[str, str]:
        """Every file of the finished set-up, the installed packages in any order."""
        found = (path for name in DONE[1:] for path in sorted((self.path / name).rglob("*")))
        files = [path for path in found if path.is_file() and not path.is_symlink()]
        packages = "\n".join(sorted(set((self.path / DONE[0]).read_text().split())))
        return {
            "packages": packages,
            **{str(path.relative_to(self.path)): path.read_text().replace(str(self.path), "") for path in files},
        }


@pytest.fixture
def world():
    folder = Path(tempfile.mkdtemp(prefix="amaze setup ü "))
    folder.chmod(0o755)  # pytest's own are for root alone
    yield World(folder)
    shutil.rmtree(folder)


MOMENTS = "lists", "packages", "environment", "its installer", "what builds", "ours", "the page", "configure", "make"
ALL = list(range(1, len(MOMENTS) + 1))
DRAWN = [
    (by, at) for by in ("KILL", "TERM", "INT") for at in random.Random(by).sample(ALL, len(ALL) if by == "KILL" else 3)
]


def test_a_first_set_up_does_everything_once_and_the_second_nothing(world):
    first = world.run()

    assert first.returncode == 0, first.stderr
    assert len((world.path / "moments").read_text().split()) == len(MOMENTS)
    assert world.done() == [
        *("apt-get update", "apt-get install", "apt-get install", "dpkg --configure", "apt-get install"),
        *("python3 -m", *["pip install"] * 4, "cmake -S", "cmake --build"),
    ]
    assert (world.run().returncode, world.done()) == (0, [])


@pytest.mark.parametrize("rostest", ["usr/lib/x86_64-linux-gnu/cmake/rostest", "usr/share/rostest/cmake"])
def test_what_a_flight_needs_has_no_compiler_what_tests_need_has(world, rostest):
    def built() -> list[str]:
        lines = (world.path / "log").read_text().splitlines()
        return [word for line in lines if line.startswith("cmake -S") for word in line.split() if word.startswith("-D")]

    of_tests = {"build-essential", "librostest-dev", "python3-rostest"}

    assert world.run("install").returncode == 0
    assert not of_tests & set((world.path / "installed").read_text().split())
    assert {"-DCATKIN_ENABLE_TESTING=OFF", "-DLANGUAGES=NONE"} <= set(built())

    (world.path / rostest).mkdir(parents=True)
    assert world.run("build").returncode == 0
    assert of_tests <= set((world.path / "installed").read_text().split())
    assert "-DCATKIN_ENABLE_TESTING=ON" in built()
    assert "-DLANGUAGES=NONE" not in built()

    assert world.run("install").returncode == 0
    assert built() == [], "what was built for tests is good for flying"


@pytest.fixture(scope="module")
def whole():
    """Return what an undisturbed set-up leaves."""
    folder = Path(tempfile.mkdtemp(prefix="amaze setup ü "))
    undisturbed = World(folder)
    assert undisturbed.run().returncode == 0
    yield undisturbed.left()
    shutil.rmtree(folder)


@pytest.mark.parametrize("by, at", DRAWN, ids=lambda each: MOMENTS[each - 1] if isinstance(each, int) else each)
def test_what_was_interrupted_is_completed_by_the_same_command(world, whole, by, at):
    ended = world.run(END_AT=str(at), END_BY=by)
    assert ended.returncode == (130 if by == "INT" else -getattr(signal, f"SIG{by}")), ended.stderr
    interrupted = "run: interrupted; what was finished is kept, and the same command goes on from there"
    assert (ended.stderr.splitlines()[-1:] == [interrupted]) == (by == "INT")

    again = world.run()

    assert again.returncode == 0, again.stdout + again.stderr
    assert world.left() == whole
    assert (world.run().returncode, world.done()) == (0, [])


@pytest.mark.skipif(os.geteuid() != 0, reason="becomes another user")
def test_a_user_with_sudo_needs_no_root_but_for_packages(world):
    result = world.run(user=NOBODY)

    assert result.returncode == 0, result.stderr
    became = [line for line in (world.path / "log").read_text().splitlines() if line.startswith("sudo ")]
    assert [line.split()[3:5] for line in became] == [
        ["true"],
        ["apt-get", "update"],
        ["dpkg", "--configure"],
        ["apt-get", "install"],
    ], "it asks for the password first, where its question can be seen"
    assert {path.stat().st_uid for path in world.checkout.rglob("*")} == {NOBODY}


@pytest.mark.skipif(os.geteuid() != 0, reason="becomes another user")
def test_a_user_whom_sudo_refuses_is_told_so_before_anything_is_done(world):
    result = world.run(user=NOBODY, REFUSED="yes")

    assert result.returncode == 1
    assert "run: sudo was refused; as root, or by a user who may: apt-get install " in result.stderr
    assert world.done() == []


@pytest.mark.skipif(os.geteuid() != 0, reason="becomes another user")
def test_what_root_has_made_is_named_to_the_user_who_comes_later(world):
    assert world.run().returncode == 0
    command = ["setpriv", f"--reuid={NOBODY}", "--clear-groups", "bash", str(world.checkout / "run"), "install"]

    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)

    words = "run: build belongs to root, who ran it before: sudo chown -R nobody build .venv"
    assert (result.returncode, result.stderr.strip()) == (1, words)


def test_what_cannot_be_made_in_the_checkout_of_another_is_named(world):
    (world.checkout / "build").write_text("nobody can make a folder in it\n")

    result = world.run()

    words = f"build/ cannot be made in {world.checkout}, which belongs to {world.checkout.owner()}"
    assert (result.returncode, result.stderr.strip()) == (1, f"run: {words}: use a checkout of your own")


CHANGES = {
    "dates": (lambda folder: [os.utime(path) for path in folder.rglob("*.*")], []),
    "a tool's settings": (lambda folder: (folder / "pyproject.toml").open("a").write("line = 1\n"), []),
    "a requirement": (lambda folder: (folder / "setup.py").write_text("newer"), ["pip install"] * 2),
    "a message": (lambda folder: old(folder / "msg" / "Told.msg"), ["cmake -S", "cmake --build"]),
    "a message less": (lambda folder: (folder / "srv" / "Told.msg").unlink(), ["cmake -S", "cmake --build"]),
    "the folder": (lambda folder: folder, ["python3 -", "cmake -S", "cmake --build"]),
}


def old(message: Path) -> None:
    """Change it as an archive does, which keeps dates: it is older than what was built of the one before."""
    message.write_text("bool heard\n")
    os.utime(message, (1e9, 1e9))


@pytest.mark.parametrize("change", CHANGES)
def test_after_a_pull_what_has_changed_is_done_again_and_only_that(world, change):
    assert world.run().returncode == 0
    (world.checkout / "srv" / "Other.srv").touch()
    assert world.run().returncode == 0
    CHANGES[change][0](world.checkout)
    if change == "the folder":
        world.checkout = world.checkout.rename(world.path / "moved folder")

    result = world.run()

    assert (result.returncode, world.done()) == (0, CHANGES[change][1]), result.stderr
    assert (world.run().returncode, world.done()) == (0, [])


def test_an_environment_whose_move_was_interrupted_is_made_afresh(world):
    assert world.run().returncode == 0
    world.checkout = world.checkout.rename(
        world.path / "folder 2"
    )  # to replace the path twice would make it `folder 2 2`
    assert world.run(END_AT="1", END_BY="KILL").returncode == -signal.SIGKILL

    assert (world.run().returncode, world.done()[0]) == (0, "python3 -m")


def test_a_new_requirement_without_a_network_leaves_what_was_there(world):
    assert world.run().returncode == 0
    before = (world.checkout / "pyproject.toml").read_text()
    (world.checkout / "pyproject.toml").write_text(f"newer\n{before}")

    result = world.run(OFFLINE="yes")

    assert result.returncode == 1
    words = "the same command tries again, and needs a network for what is new"
    assert result.stderr.endswith(f"run: Python packages could not be installed: see above; {words}\n")
    (world.checkout / "pyproject.toml").write_text(before)
    assert world.run(OFFLINE="yes").returncode == 0


def test_a_first_set_up_without_a_network_says_what_could_not_be_made_and_is_done_later(world):
    offline = world.run(OFFLINE="pip")

    words = "the Python environment could not be made: see above; the same command tries again"
    assert (offline.returncode, offline.stderr.splitlines()[-1]) == (1, f"run: {words}")
    assert world.run().returncode == 0


def test_what_could_not_be_installed_is_not_believed_the_next_time(world):
    assert world.run().returncode == 0

    for _ in range(2):
        result = world.run("advisories", OFFLINE="pip-audit")
        assert (result.returncode, "NOBODY WAS ASKED" in result.stderr) == (3, True), result.stderr


@pytest.mark.parametrize("name", [f"a{character}b" for character in """'"`\\;:$&#()<>|*?![]{}"""])
def test_a_path_that_catkin_cannot_build_in_is_refused_before_anything_is_installed(world, name):
    world.checkout = world.checkout.rename(world.path / name)

    result = world.run()

    words = "catkin cannot build in a folder whose path has more than letters, digits, spaces and . _ - + , @ %"
    assert (result.returncode, result.stdout, result.stderr) == (1, "", f"\nrun: {words}: move {world.checkout}\n")
    assert (world.path / "log").read_text() == ""


@pytest.mark.parametrize("job", ["test", "test-ros", "test-builds"])
def test_tests_that_cannot_run_in_a_path_with_a_space_say_so_before_anything_is_installed(world, job):
    result = world.run(job)

    words = f"rostest runs no test in a folder whose path has a space: move {world.checkout} (./run demo works here)"
    assert (result.returncode, result.stdout, result.stderr) == (1, "", f"\nrun: {words}\n")
    assert (world.path / "log").read_text() == ""


def test_a_second_one_waits_for_the_first_and_says_so(world):
    (world.checkout / "build").mkdir()
    with (world.checkout / "build" / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        (world.path / "programs" / "flock").write_text('#!/bin/sh\n[ "$1" != -n ] || exec /usr/bin/flock "$@"\n')
        (world.path / "programs" / "flock").chmod(0o755)  # the lock is let go as soon as it is waited for

        result = world.run()

    assert result.returncode == 0
    assert "== another ./run sets up this folder: waiting for it" in result.stderr
