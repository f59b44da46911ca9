"""Places on the earth, and the same places in metres around a home: a plane that touches WGS 84 there.

Good to a millimetre per 100 m from home and to a tenth of a metre at 5 km, below 80 degrees of latitude; there and back
is exact to less than the 1e-7 degrees that MAVLink carries.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Tuple

__all__ = ["Home", "Place"]

_A_M = 6378137.0  # WGS 84: semi-major axis
_E2 = 6.69437999014e-3  # and first eccentricity squared


class Place(NamedTuple):
    """A place on the earth.

    Args:
        latitude_deg: north.
        longitude_deg: east.
    """

    latitude_deg: float
    longitude_deg: float


@dataclass(frozen=True)
class Home:
    """Origin of a local frame (ENU, REP-103): the position of a mission's first takeoff."""

    latitude_deg: float
    longitude_deg: float

    def _metres_per_degree(self) -> Tuple[float, float]:
        """Return metres per degree of latitude and of longitude."""
        latitude = math.radians(self.latitude_deg)
        square = 1.0 - _E2 * math.sin(latitude) ** 2
        north = _A_M * (1.0 - _E2) / square**1.5
        east = _A_M / math.sqrt(square) * math.cos(latitude)
        return math.radians(north), math.radians(east)

    def to_local(self, place: Place) -> Tuple[float, float]:
        """Return metres east and north of home."""
        per_latitude, per_longitude = self._metres_per_degree()
        east = (place.longitude_deg - self.longitude_deg + 180.0) % 360.0 - 180.0
        return east * per_longitude, (place.latitude_deg - self.latitude_deg) * per_latitude

    def to_global(self, x_m: float, y_m: float) -> Place:
        """Return the place that is so many metres east and north of home."""
        per_latitude, per_longitude = self._metres_per_degree()
        longitude = (self.longitude_deg + x_m / per_longitude + 180.0) % 360.0 - 180.0
        return Place(self.latitude_deg + y_m / per_latitude, longitude)
