"""Where the simulated vehicle's local frame lies on the earth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

__all__ = ["Geography", "Place"]

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
