"""Places on the earth in metres around a home."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from amaze_autonomy.missions import Home, Place

DEGREES = st.floats(-80.0, 80.0), st.floats(-180.0, 180.0)
METRES = st.floats(-5000.0, 5000.0)


@given(st.builds(Home, *DEGREES), METRES, METRES)
def test_there_and_back_is_finer_than_mavlink_carries(home, x, y):
    east, north = home.to_local(home.to_global(x, y))
    assert abs(east - x) < 1e-4
    assert abs(north - y) < 1e-4


@pytest.mark.parametrize(
    "latitude, per_latitude, per_longitude",  # published lengths of a degree on WGS 84
    [(0.0, 110574.3, 111319.5), (45.0, 111131.8, 78846.8), (60.0, 111412.2, 55800.0)],
)
def test_a_degree_is_as_long_as_the_tables_say(latitude, per_latitude, per_longitude):
    east, north = Home(latitude, 10.0).to_local(Place(latitude + 0.01, 10.01))
    assert north * 100 == pytest.approx(per_latitude, abs=1.0)
    assert east * 100 == pytest.approx(per_longitude, abs=1.0)


def test_the_date_line_is_no_border():
    east, north = Home(10.0, 179.9999).to_local(Place(10.0, -179.9999))
    assert (round(east, 2), north) == (21.93, 0.0)
    assert Home(10.0, 179.9999).to_global(east, 0.0).longitude_deg == pytest.approx(-179.9999)
