"""Waypoint files, and the places on the earth that they may start from: comma-separated, a header, one waypoint a line.

    # frame: east_north         metres east and north of the mission's first takeoff; or start_heading, below
    x,y,z,yaw_deg,holdtime      metres above where this file takes off, yaw counter-clockwise from the x axis in degrees
    2.0,0.0,1.5,0.0,1.0         (yaw_rad: in radians), seconds to hold there

With `# frame: start_heading` x is ahead of and y left of the vehicle as it stands when it takes off with this file, and
a yaw of 0 is the heading that it has then. A file that does not say its frame takes it from its mission; where neither
does, and where a column is called `yaw` and nothing says its unit, the file is refused with what to write. The columns
may stand in any order; `holdtime` may be left out and is then 0. Other lines that begin with #, and empty ones, are not
looked at. Files in latitude and longitude: `routes.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, Sequence, Tuple

from .csv_table import YAW_COLUMNS, Frame, Layout, Said, frame_of, lines_of, read_table, said_in, yaw_of, yaw_unit_of
from .errors import WaypointError

# --- places on the earth ----------------------------------------------------------------------------------------------
# Good to a millimetre per 100 m from home and to a tenth of a metre at 5 km, below 80 degrees of latitude; there and
# back is exact to less than the 1e-7 degrees that MAVLink carries.


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


# --- waypoint files ---------------------------------------------------------------------------------------------------


COLUMNS = ("x", "y", "z", "yaw", "holdtime")
_LAYOUT = Layout(
    COLUMNS,
    ("holdtime",),
    "must be the columns x,y,z,yaw_deg,holdtime, separated by commas (or yaw_rad, in radians)",
)


class Names(NamedTuple):
    """What a file calls the parts of a waypoint, for errors."""

    place: str = "x,y"
    height: str = "z"
    whole: str = "x,y,z"
    hold: str = "holdtime"


LOCAL_NAMES = Names()


@dataclass(frozen=True)
class Waypoint:
    """A place to fly to in the frame of its trajectory (REP-103: x east, y north, z up; or x ahead, y left, z up).

    Args:
        x_m: east, or ahead.
        y_m: north, or left.
        z_m: up.
        yaw_rad: counter-clockwise from x.
        hold_s: how long to stay.
        line: of the file it was read from, for errors.
    """

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    hold_s: float
    line: int = 0


@dataclass(frozen=True)
class Trajectory:
    """The waypoints of one file.

    Args:
        file: its name, relative to the configuration's folder.
        waypoints: at least one.
        yaw_column: name of its yaw column, for errors.
        names: of its other columns.
        places: of the waypoints on the earth, as the file says them; empty when the file is in local metres.
        frame: of the waypoints.
        parts: the files that it is made of, when they are flown without a touchdown; empty: it is one file.
    """

    file: str
    waypoints: Tuple[Waypoint, ...]
    yaw_column: str = "yaw"
    names: Names = LOCAL_NAMES
    places: Tuple[Place, ...] = ()
    frame: Frame = Frame.EAST_NORTH
    parts: Tuple[Trajectory, ...] = ()

    def error(self, waypoint: Waypoint, column: str, wrong: str, right: str) -> WaypointError:
        """Return what is wrong with a waypoint, at its place in its file; `column` is a field of `Names`, or empty."""
        part = next((each for each in self.parts if any(waypoint is one for one in each.waypoints)), self)
        return WaypointError(part.file, waypoint.line, getattr(part.names, column) if column else "", wrong, right)

    def hovering(self, time_s: float) -> Trajectory:
        """Return it with a longer hold at its last waypoint."""
        *others, last = self.waypoints
        return replace(self, waypoints=(*others, replace(last, hold_s=last.hold_s + time_s)))

    def from_start(self, heading_rad: float, x_m: float = 0.0, y_m: float = 0.0) -> Trajectory:
        """Return it in metres east and north, for a takeoff at x, y with a heading counter-clockwise from east."""
        if self.frame is Frame.EAST_NORTH:
            return self
        cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
        turned = tuple(
            replace(
                each,
                x_m=x_m + cosine * each.x_m - sine * each.y_m,
                y_m=y_m + sine * each.x_m + cosine * each.y_m,
                yaw_rad=math.remainder(each.yaw_rad + heading_rad, 2 * math.pi),
            )
            for each in self.waypoints
        )
        return replace(self, waypoints=turned, frame=Frame.EAST_NORTH)


def joined(trajectories: Sequence[Trajectory]) -> Trajectory:
    """Return several files of one frame as one, flown without a touchdown."""
    on_earth = all(each.places for each in trajectories)
    return replace(
        trajectories[0],
        file=" + ".join(each.file for each in trajectories),
        waypoints=tuple(waypoint for each in trajectories for waypoint in each.waypoints),
        places=tuple(place for each in trajectories for place in each.places) if on_earth else (),
        parts=tuple(trajectories),
    )


def parse_trajectory(text: str, file: str, mission: Said = Said()) -> Trajectory:  # noqa: B008 - it cannot change
    """Read a whole waypoint file in local metres; `mission` is what its mission says of files that do not say it.

    Raises:
        WaypointError: the first mistake in it, with line and column.
    """
    lines = lines_of(text)
    columns, rows = read_table(file, lines, _LAYOUT)
    said, header = said_in(file, text), lines[0][0]
    column = next(column for column in columns if column in YAW_COLUMNS)
    frame = frame_of(file, header, said, mission)
    unit = yaw_unit_of(file, header, column, said, mission)
    waypoints = tuple(
        Waypoint(
            row.values["x"],
            row.values["y"],
            row.values["z"],
            yaw_of(file, row, unit),
            row.values.get("holdtime", 0.0),
            row.line,
        )
        for row in rows
    )
    return Trajectory(file, waypoints, column, frame=frame)
