"""What can be chosen about the simulated PX4 beyond how the vehicle flies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Mapping, Tuple, Union

from .geography import Geography

__all__ = ["PARAMETERS", "Px4Settings"]

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
        range_finder: it has a downward range finder of its own.
        unacknowledged: commands (MAV_CMD) to which it sends no COMMAND_ACK, as PX4 now and then does.
        boot_ns: how long it is on already when the simulation begins.
        mission_capacity: items that it can hold.
    """

    system: int = 1
    geography: Geography = field(default_factory=Geography)
    parameters: Mapping[str, Union[int, float]] = field(default_factory=dict)
    transmitter: bool = True
    range_finder: bool = True
    unacknowledged: Tuple[int, ...] = ()
    boot_ns: int = 60_000_000_000
    mission_capacity: int = 500
