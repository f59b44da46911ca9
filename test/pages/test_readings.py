"""Series for a page: no peak and no gap is lost, numbers are packed as a browser reads them, rates have their gaps."""

from __future__ import annotations

from base64 import b64decode

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from replay_bags import START_NS, S, distance, write_bag

from amaze_autonomy.pages.readings import bin_of, packed, rates_of, thinned, with_gaps
from amaze_autonomy.replay.monitors.upsets import tilt_deg
from amaze_autonomy.replay.recordings.sources import Recordings

VALUES = st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=400)


@given(values=VALUES, most=st.integers(8, 100))
def test_thinning_keeps_ends_extremes_order_and_every_gap(values, most):
    t_s = np.arange(len(values)) * 0.1
    kept_t, kept = thinned(t_s, values, most)
    values = np.array(values)
    known, left = values[~np.isnan(values)], kept[~np.isnan(kept)]
    assert (kept_t[0], kept_t[-1]) == (t_s[0], t_s[-1])
    assert (np.diff(kept_t) > 0).all()
    if len(known):
        assert (left.min(), left.max()) == (known.min(), known.max())
    begins = np.flatnonzero(np.isnan(values) & ~np.concatenate(([False], np.isnan(values[:-1]))))
    assert set(t_s[begins]) <= set(kept_t[np.isnan(kept)])
    assert len(kept) <= max(most, 4) + len(begins) + 4


def test_a_single_spike_among_a_million_samples_is_kept():
    values = np.zeros(1_000_000)
    values[654_321] = 31.0
    t_s, kept = thinned(np.arange(1_000_000) * 0.005, values, 20_000)
    assert len(kept) <= 20_004
    assert t_s[kept.argmax()] == pytest.approx(654_321 * 0.005)


def test_numbers_are_packed_as_32_bit_floats_of_a_browser():
    assert list(np.frombuffer(b64decode(packed([1.5, -2.0])), "<f4")) == [1.5, -2.0]


def test_no_line_goes_across_a_silence():
    t_s, values = with_gaps([0.0, 0.1, 0.2, 3.0, 3.1], [1.0, 2.0, 3.0, 4.0, 5.0])
    assert np.isnan(values).tolist() == [False, False, False, True, False, False]
    assert t_s[3] == pytest.approx(0.201)


def test_tilt_is_the_angle_of_the_vehicle_s_z_axis_to_up_and_unknown_for_no_orientation():
    half = np.radians(30.0) / 2
    parts = np.array([[0.0, 0.0, 0.0, 1.0], [np.sin(half), 0.0, 0.0, np.cos(half)], [0.0, 0.0, 0.0, 0.0]]).T
    assert tilt_deg(*parts) == pytest.approx([0.0, 30.0, np.nan], nan_ok=True)


def test_a_topic_s_rate_its_silences_and_the_longest_of_them(tmp_path):
    times = [*range(40), *range(60, 101)]  # 10 Hz, silent from 3.9 s to 6 s
    rows = [(START_NS + at * S // 10, "/range", distance(START_NS, 1.0)) for at in times]
    with Recordings([write_bag(tmp_path / "a.bag", rows)], ["/range"]) as recordings:
        (rate,) = rates_of(recordings, [("/range", "lrf", 10.0, 0.5)], 1.0)
    assert rate.bins == (10.0, 10.0, 10.0, 10.0, 0.0, 0.0, 10.0, 10.0, 10.0, 11.0)
    assert rate.gaps == ((3.9, 6.0),)
    assert (rate.longest_s, rate.longest_at_s) == pytest.approx((2.1, 3.9))
    assert (rate.component, rate.messages, rate.expected_hz) == ("lrf", 81, 10.0)


def test_a_slow_topic_s_rate_is_taken_over_some_messages_and_does_not_flicker(tmp_path):
    rows = [(START_NS + at * S * 2 // 5, "/range", distance(START_NS, 1.0)) for at in range(51)]  # 2.5 Hz
    with Recordings([write_bag(tmp_path / "a.bag", rows)], ["/range"]) as recordings:
        (rate,) = rates_of(recordings, [("/range", "lrf", 2.5, None)], 1.0)
    assert set(rate.bins[1:-1]) == {2.5}


@pytest.mark.parametrize("length_ms", [10_000, 10_010, 10_200, 10_900])
def test_a_recording_that_ends_within_a_bin_has_its_rate_to_the_end(tmp_path, length_ms):
    rows = [(START_NS + at * S // 1000, "/range", distance(START_NS, 1.0)) for at in range(0, length_ms + 1, 10)]
    with Recordings([write_bag(tmp_path / "a.bag", rows)], ["/range"]) as recordings:
        (rate,) = rates_of(recordings, [("/range", "lrf", 100.0, None)], 1.0)
    assert rate.bins == pytest.approx((100.0,) * len(rate.bins), abs=1.5)


def test_a_topic_that_is_not_there_has_no_rate(tmp_path):
    rows = [(START_NS + at * S, "/range", distance(START_NS, 1.0)) for at in range(3)]
    with Recordings([write_bag(tmp_path / "a.bag", rows)], ["/range", "/imu"]) as recordings:
        (rate,) = rates_of(recordings, [("/imu", "imu", 100.0, 0.3)], 1.0)
    assert (rate.messages, rate.rate_hz, rate.longest_s, rate.gaps, set(rate.bins)) == (0, None, None, (), {0.0})


def test_a_long_recording_has_wider_bins():
    assert (bin_of(127.0), bin_of(1800.0)) == (1.0, 3.0)
