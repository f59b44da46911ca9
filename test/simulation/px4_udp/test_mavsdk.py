"""An unmodified MAVLink client: MAVSDK connects, uploads a mission, arms, takes off, flies it, lands."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest
from udp_tools import free_port, served

pytestmark = pytest.mark.live

_SEEN = ["connected", "uploaded", "armed", "took off", "flown", "landed and disarmed"]


def test_mavsdk_arms_takes_off_flies_an_uploaded_mission_and_lands():
    pytest.importorskip(
        "mavsdk.mission",
        reason="MAVSDK-PYTHON IS NOT HERE (pip install '.[test]'; its wheel needs Python 3.9 on x86-64)",
    )
    port = free_port()
    with served(speed=3.0, addresses=(f"udpout:127.0.0.1:{port}",)) as (owner, _):
        flight = [sys.executable, "-W", "ignore", str(Path(__file__).with_name("mavsdk_flight.py"))]
        done = subprocess.run(
            [*flight, f"udpin://127.0.0.1:{port}"], capture_output=True, text=True, timeout=60, check=False
        )
        assert done.stdout.splitlines() == _SEEN, done.stderr
        assert math.dist(owner.craft.position_m, (3.0, 3.0, 0.0)) < 0.1
        assert not owner.craft.armed
