"""Real recordings, each with itself and in pairs, read by every reader that is installed."""

from __future__ import annotations

import itertools
import shutil

import pytest
from bag_tools import DATA

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge.merge import MergeOptions, merge
from amaze_autonomy.bags.merge.verify import verify
from amaze_autonomy.bags.recover.recover import recover
from amaze_autonomy.bags.recover.scan import scan

NAMES = (
    "ardrone_indoor_flight",
    "crazyflie_sine",
    "example_lz4",
    "handheld_roll_pitch_yaw",
    "husky_outdoor_drive",
    "no_messages",
)
PAIRS = list(itertools.combinations_with_replacement(NAMES, 2))
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are not here: set AMAZE_DATA")


def real(name):
    return DATA / f"{name}.bag"


@pytest.mark.slow_rows
@pytest.mark.parametrize("pair", PAIRS, ids=" + ".join)
def test_two_recordings_become_one(tmp_path, pair):
    inputs = [real(name) for name in pair]
    merge(inputs, tmp_path / "merged.bag")
    assert verify(tmp_path / "merged.bag", inputs, readers="none").problems == ()


@pytest.mark.night
@pytest.mark.parametrize("compression", ["auto", "none", "lz4", "bz2"])
def test_recordings_become_one_that_everybody_reads(tmp_path, compression):
    inputs = [real(name) for name in (NAMES if compression == "auto" else NAMES[2:4])]
    merge(inputs, tmp_path / "merged.bag", MergeOptions(compression=compression))
    verified = verify(tmp_path / "merged.bag", inputs, readers="read")
    assert verified.problems == ()
    assert {reading.error for reading in verified.readings} == {""}
    expected = {"rosbags", "rosbag", "librosbag"} if shutil.which("rosbag") else {"rosbags"}
    assert {reading.reader for reading in verified.readings} >= expected


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.slow_rows
def test_a_recording_merged_with_itself_without_duplicates_is_itself(tmp_path, name):
    source = real(name)
    merged = merge([source, source], tmp_path / "merged.bag", MergeOptions(duplicates="drop"))
    once = scan(source, check_data=False).messages
    assert merged.messages == once
    assert verify(merged.path, [source], readers="none").problems == ()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.slow_rows
def test_a_recording_is_good_and_its_first_two_thirds_are_recovered(tmp_path, name):
    found = scan(real(name), check_data=True)
    assert (found.damages, found.closed) == ([], True)
    raw = real(name).read_bytes()
    (tmp_path / "cut.bag").write_bytes(raw[: len(raw) * 2 // 3])
    done = recover(tmp_path / "cut.bag", tmp_path / "recovered.bag")
    assert verify(done.path, [], readers="none").problems in ((), ("its messages are not in order of time",))


@pytest.mark.parametrize("name", NAMES[:-1])
def test_a_recording_of_which_git_took_the_carriage_returns_is_told_so(tmp_path, name):
    converted = tmp_path / "converted.bag"
    converted.write_bytes(real(name).read_bytes().replace(b"\r\n", b"\n"))
    with pytest.raises(BagError, match="git's conversion of line endings made every CR LF an LF"):
        Index(converted)
