"""A flight with MAVSDK as anybody would write it: python mavsdk_flight.py ADDRESS; prints what it saw."""

from __future__ import annotations

import asyncio
import math
import sys

from mavsdk import System
from mavsdk.mission import MissionItem, MissionPlan

_METRE_DEG = 1.0 / 111_195.0


async def first(stream, condition):
    """Return the first value of a stream for which a condition is true."""
    async for value in stream:
        if condition(value):
            return value
    raise RuntimeError("the stream ended")


def waypoint(place, north_m, east_m, up_m):
    """Return a waypoint some metres from a place."""
    nan = float("nan")
    east_deg = east_m * _METRE_DEG / math.cos(math.radians(place.latitude_deg))
    return MissionItem(
        place.latitude_deg + north_m * _METRE_DEG, place.longitude_deg + east_deg, up_m, 2.0, False, nan, nan,
        MissionItem.CameraAction.NONE, 0.5, nan, 1.0, nan, nan, MissionItem.VehicleAction.NONE,
    )  # fmt: skip


async def fly(address):
    """Connect, arm, take off, fly an uploaded mission, land."""
    drone = System()
    await drone.connect(system_address=address)
    await first(drone.core.connection_state(), lambda state: state.is_connected)
    await first(drone.telemetry.health(), lambda health: health.is_global_position_ok and health.is_home_position_ok)
    print("connected", flush=True)
    place = await first(drone.telemetry.position(), lambda _: True)
    await drone.mission.set_return_to_launch_after_mission(False)
    await drone.mission.upload_mission(
        MissionPlan([waypoint(place, *each) for each in ((0, 0, 2), (3, 0, 2), (3, 3, 2))])
    )
    print("uploaded", flush=True)
    await drone.action.arm()
    print("armed", flush=True)
    await drone.action.set_takeoff_altitude(2.0)
    await drone.action.takeoff()
    await first(drone.telemetry.position(), lambda at: at.relative_altitude_m > 1.7)
    print("took off", flush=True)
    await drone.mission.start_mission()
    await first(drone.mission.mission_progress(), lambda progress: progress.current == progress.total > 0)
    print("flown", flush=True)
    await drone.action.land()
    await first(drone.telemetry.armed(), lambda armed: not armed)
    print("landed and disarmed", flush=True)


if __name__ == "__main__":
    asyncio.run(asyncio.wait_for(fly(sys.argv[1]), 50.0))
