"""What can be chosen about the simulated PX4 beyond how the vehicle flies."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Mapping, Tuple, Union

# --- geography --------------------------------------------------------------------------------------------------------
# Where the simulated vehicle's local frame lies on the earth.


_RADIUS_M = 6371000.0  # PX4's figure
_DEG7 = 1e7


@dataclass(frozen=True)
class Place:
    """A place on the earth.

    Args:
        latitude_deg: north of the equator.
        longitude_deg: east of Greenwich.
        altitude_m: above mean sea level.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    @property
    def lat(self) -> int:
        """Latitude in 1e-7 degrees, as in MAVLink."""
        return round(self.latitude_deg * _DEG7)

    @property
    def lon(self) -> int:
        """Longitude in 1e-7 degrees, as in MAVLink."""
        return round(self.longitude_deg * _DEG7)

    @property
    def alt_mm(self) -> int:
        """Altitude in millimetres, as in MAVLink."""
        return round(self.altitude_m * 1000.0)


@dataclass(frozen=True)
class Geography:
    """A local frame: east, north and up of an origin; flat, good to centimetres over a kilometre.

    Args:
        origin: where east, north and up are 0. The default is that of PX4's own simulation.
    """

    origin: Place = Place(47.397743, 8.545594, 489.4)

    def place(self, east_m: float, north_m: float, up_m: float) -> Place:
        """Return the place of a local position."""
        origin = self.origin
        latitude = origin.latitude_deg + math.degrees(north_m / _RADIUS_M)
        longitude = origin.longitude_deg + math.degrees(east_m / (_RADIUS_M * self._shrinking))
        return Place(latitude, longitude, origin.altitude_m + up_m)

    def local(self, latitude_deg: float, longitude_deg: float) -> Tuple[float, float]:
        """Return metres east and north of the origin."""
        north = math.radians(latitude_deg - self.origin.latitude_deg) * _RADIUS_M
        east = math.radians(longitude_deg - self.origin.longitude_deg) * _RADIUS_M * self._shrinking
        return east, north

    @property
    def _shrinking(self) -> float:
        return math.cos(math.radians(self.origin.latitude_deg))


# --- settings ---------------------------------------------------------------------------------------------------------


# Those that a computer on board reads or that change what the simulated vehicle does, with PX4's defaults.
PARAMETERS: Mapping[str, Union[int, float]] = {
    "BAT1_N_CELLS": 6,
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "BAT_LOW_THR": 0.15,
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_DL_LOSS_T": 10,
    "COM_FAIL_ACT_T": 5.0,
    "COM_LOW_BAT_ACT": 0,
    "COM_OBL_RC_ACT": 0,
    "COM_OF_LOSS_T": 1.0,
    "COM_POSCTL_NAVL": 0,
    "COM_RC_IN_MODE": 0,
    "COM_RC_LOSS_T": 0.5,
    "COM_RCL_EXCEPT": 0,
    "COM_RC_OVERRIDE": 1,
    "GF_ACTION": 2,
    "MAV_COMP_ID": 1,
    "MAV_SYS_ID": 1,
    "MIS_DIST_1WP": 10000.0,
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_LAND_SPEED": 0.7,
    "MPC_TKO_SPEED": 1.5,
    "MPC_XY_CRUISE": 5.0,
    "NAV_ACC_RAD": 2.0,
    "NAV_DLL_ACT": 0,
    "NAV_RCL_ACT": 2,
    "RTL_RETURN_ALT": 60.0,
    "SIM_BAT_DRAIN": 60.0,
    "SIM_BAT_MIN_PCT": 50.0,
    "SIM_GPS_USED": 10,
    "SYS_AUTOSTART": 10040,
}


@dataclass(frozen=True)
class Px4Settings:
    """One simulated PX4.

    Args:
        system: its system id.
        geography: where its local frame lies.
        parameters: that differ from PX4's own, by name.
        transmitter: the pilot's transmitter is on.
        land_channel: of it, from 1, that its land switch moves; 0: it has none.
        range_finder: it has a downward range finder of its own.
        unacknowledged: commands (MAV_CMD) to which it sends no COMMAND_ACK, as PX4 now and then does.
        boot_ns: how long it is on already when the simulation begins.
        mission_capacity: items that it can hold.
        signing_key: with which it signs what it sends, and believes nothing else; empty: neither.
    """

    system: int = 1
    geography: Geography = field(default_factory=Geography)
    parameters: Mapping[str, Union[int, float]] = field(default_factory=dict)
    transmitter: bool = True
    land_channel: int = 0
    range_finder: bool = True
    unacknowledged: Tuple[int, ...] = ()
    boot_ns: int = 60_000_000_000
    mission_capacity: int = 500
    signing_key: bytes = b""
