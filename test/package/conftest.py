from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "test" / "cns"))
NOT_SOURCE = shutil.ignore_patterns("build", "__pycache__", ".*")
PATIENCE_S = 1200  # an emulated machine is slow


def content(folder: Path) -> dict[str, str]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="session")
def build_copy():
    """Copy the source tree to a folder, build there, and see that the build has left it as it was."""

    def build(source: Path, command: str, workspace: Path) -> None:
        shutil.copytree(ROOT, source, ignore=NOT_SOURCE)
        before = content(source)
        login_shell(command, workspace)
        assert content(source) == before, "the build has written into the source tree"

    return build


@pytest.fixture(scope="session")
def shell():
    return login_shell


def login_shell(command: str, folder: Path, **variables: str) -> str:
    """Run a command in bash as after a fresh login, without pyenv or virtual environment; return what it prints."""
    kept = {name: value for name, value in os.environ.items() if name.startswith("PIP_") or "proxy" in name.lower()}
    own = {"PATH": "/usr/local/bin:/usr/bin:/bin", "HOME": str(folder), "ROS_IP": "127.0.0.1", "LC_ALL": "C.UTF-8"}
    process = subprocess.Popen(
        ["bash", "-c", command],
        cwd=folder,
        env={**kept, **own, **variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=PATIENCE_S)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 0, f"status {process.returncode} of: {command}\n{output}"
    return output
