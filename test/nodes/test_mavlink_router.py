"""The start of mavlink-router; a program of that name, made here, shows what it would have been told."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from dataclasses import replace

import pytest

from amaze_autonomy.config import AutopilotSettings, LinkSettings
from amaze_autonomy.config.errors import EndpointError
from amaze_autonomy.nodes.vehicle.mavlink_router import arguments_of

PROGRAM = "import sys; from amaze_autonomy.nodes.vehicle.mavlink_router import main; sys.exit(main())"


def started(*arguments, path):
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *arguments],
        env={**os.environ, "PATH": str(path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_each_link_is_an_endpoint_and_the_device_comes_last():
    assert arguments_of("/dev/ttyACM0:921600", AutopilotSettings()) == [
        "mavlink-routerd",
        "-t",
        "0",
        "-e",
        "127.0.0.1:14540",
        "-e",
        "127.0.0.1:14541",
        "/dev/ttyACM0:921600",
    ]


@pytest.mark.parametrize("url", ["udpout:127.0.0.1:14540", "serial:/dev/ttyACM0:57600", "tcp:127.0.0.1:5760"])
def test_a_link_that_does_not_wait_on_udp_cannot_be_reached(url):
    with pytest.raises(EndpointError, match="cannot be reached by a router"):
        arguments_of("/dev/ttyACM0", replace(AutopilotSettings(), link=LinkSettings(url=url)))


@pytest.mark.parametrize(
    "url, place",
    [
        ("udpin:192.168.1.2:14540", "192.168.1.2:14540"),
        ("udp:0.0.0.0:14540", "127.0.0.1:14540"),
        ("udpin:[::1]:14540", "[::1]:14540"),
        ("udpin:::1:14540", "[::1]:14540"),
        ("udpin:[::]:14540", "[::1]:14540"),
        ("udpin:[0::0]:14540", "[::1]:14540"),
    ],
)
def test_a_link_is_reached_where_it_waits(url, place):
    command = arguments_of("/dev/ttyACM0", replace(AutopilotSettings(), link=LinkSettings(url=url)))
    assert command[4] == place


@pytest.mark.parametrize("found, place", [("127.0.0.1", "127.0.0.1:14540"), ("::1", "[::1]:14540")])
def test_localhost_is_the_address_at_which_the_link_waits(found, place, monkeypatch):
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: [(0, 0, 0, "", (found, 14540))])
    command = arguments_of("/dev/ttyACM0", replace(AutopilotSettings(), link=LinkSettings(url="udpin:localhost:14540")))
    assert command[4] == place


@pytest.mark.parametrize("url", ["udpin:companion.local:14540", "udpin:127.1:14540"])
def test_a_name_that_a_router_does_not_look_up_is_refused(url):
    with pytest.raises(EndpointError, match="names a host that a router cannot send to"):
        arguments_of("/dev/ttyACM0", replace(AutopilotSettings(), link=LinkSettings(url=url)))


def test_it_becomes_the_router(tmp_path):
    router = tmp_path / "mavlink-routerd"
    router.write_text('#!/bin/sh\necho "router $*"\nexit 7\n')
    router.chmod(0o755)
    overrides = "autopilot.link.url=udpin:0.0.0.0:15000; autonomy.require_go=true"
    done = started("/dev/ttyS1:57600", "__name:=router", "--overrides", overrides, path=tmp_path)
    assert (done.returncode, done.stdout) == (7, "router -t 0 -e 127.0.0.1:15000 -e 127.0.0.1:14541 /dev/ttyS1:57600\n")


@pytest.mark.parametrize(
    "device, words",
    [
        ("/dev/ttyS1:57600", "mavlink-routerd is not installed; build it from"),
        ("/dev/ttyS1:fast", "names no device and baud rate"),
    ],
)
def test_what_cannot_be_started_is_one_line(device, words, tmp_path):
    done = started(device, path=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert words in done.stderr
