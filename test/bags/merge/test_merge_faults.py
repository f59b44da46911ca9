"""Nothing is lost when a merge is killed or the disk is full: inputs untouched, no half output, the next try works."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bag_tools import bag, digest, left_over, rows, text, unclosed
from replay_bags import START_NS

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.merge import merge as merge_module
from amaze_autonomy.bags.merge.merge import MergeOptions, merge
from amaze_autonomy.bags.merge.verify import verify
from amaze_autonomy.bags.recover.recover import recover
from amaze_autonomy.bags.write import Output
from amaze_autonomy.files import temporary_name

pytestmark = pytest.mark.live

SOURCE = Path(__file__).parents[3] / "src"


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    return [
        bag(folder / "1.bag", rows("/a", 12_000, 1), chunk_bytes=20_000),
        bag(folder / "2.bag", rows("/b", 12_000, 1), chunk_bytes=20_000),
    ]


def merging(output, inputs):
    """Start a merge in a process of its own; return its number."""
    child = os.fork()
    if child:
        return child
    try:
        merge(inputs, output, MergeOptions(compression="lz4", replace=True))
        os._exit(0)
    finally:
        os._exit(1)


def duration_s(output, inputs):
    began = time.monotonic()
    assert os.waitpid(merging(output, inputs), 0)[1] == 0
    return time.monotonic() - began


def test_killed_at_twenty_moments_it_leaves_nothing_half_and_can_be_done_again(tmp_path, inputs):
    output, before = tmp_path / "merged.bag", [digest(path) for path in inputs]
    whole_s = duration_s(output, inputs)
    expected = digest(output)
    output.unlink()
    chance, outcomes = random.Random(3), []
    for _ in range(20):
        child = merging(output, inputs)
        time.sleep(chance.uniform(0, whole_s))  # the moment is what is tested
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        outcomes.append("whole" if output.exists() else "half" if temporary_name(output).exists() else "nothing")
        if output.exists():
            assert digest(output) == expected
            output.unlink()
    assert outcomes.count("half") >= 3, outcomes
    assert [digest(path) for path in inputs] == before
    merge(inputs, output, MergeOptions(compression="lz4"))
    assert digest(output) == expected
    assert left_over(tmp_path) == []
    assert verify(output, inputs, readers="none").problems == ()


def test_two_merges_of_one_output_do_not_disturb_each_other(tmp_path, inputs):
    output = tmp_path / "merged.bag"
    with Output(output):
        with pytest.raises(BagError, match=r"merged\.bag: is being written by another process; wait for it"):
            merge(inputs, output)
        assert temporary_name(output).exists()
    assert left_over(tmp_path) == []


@pytest.fixture
def small_disk(tmp_path):
    """Mount a disk of one megabyte; where that is not allowed, a limit on the size of files stands in (see there)."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if subprocess.run(command, check=False, timeout=60).returncode:
        pytest.skip("only root may mount a small disk; test_files_may_not_grow_further is the same without one")
    yield folder
    subprocess.run(["umount", str(folder)], check=True, timeout=60)


def test_a_full_disk_is_said_before_the_merge(small_disk, inputs):
    before = [digest(path) for path in inputs]
    with pytest.raises(BagError) as caught:
        merge(inputs, small_disk / "merged.bag")
    assert "merged.bag: there is no space for it: about " in str(caught.value)
    assert str(caught.value).endswith("; make space and try again, nothing was changed")
    assert list(small_disk.iterdir()) == []
    assert [digest(path) for path in inputs] == before


def test_a_disk_that_fills_up_during_the_merge_is_said_and_the_next_try_works(small_disk, inputs):
    (small_disk / "other").write_bytes(bytes(500_000))
    chance = random.Random(1)
    noise = [(START_NS + each, "/a", text(f"{chance.getrandbits(400_000):x}")) for each in range(20)]
    one = bag(small_disk.parent / "noise.bag", noise)
    with pytest.raises(BagError, match=r"there is no space for it \(No space left on device after [\d,]+ bytes\)"):
        merge([one], small_disk / "merged.bag", MergeOptions(compression="lz4"))
    assert [path.name for path in small_disk.iterdir()] == ["other"]
    (small_disk / "other").unlink()
    merge(inputs[:1], small_disk / "merged.bag", MergeOptions(compression="lz4"))
    assert verify(small_disk / "merged.bag", inputs[:1], readers="none").problems == ()


def test_a_full_disk_stops_a_recovery_before_it_begins(small_disk, inputs):
    active = unclosed(inputs[0], inputs[0].with_name("x.bag.active"))
    before = digest(active)
    with pytest.raises(BagError, match="there is no space for it"):
        recover(active, small_disk / "x.bag")
    assert list(small_disk.iterdir()) == []
    assert digest(active) == before


LIMITED = """
import resource, signal, sys
from pathlib import Path
from amaze_autonomy.bags.cli import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
raise SystemExit(main(["merge", *sys.argv[1:]]))
"""


def test_files_may_not_grow_further(tmp_path, inputs):
    command = [sys.executable, "-c", LIMITED, *map(str, inputs), "-o", str(tmp_path / "merged.bag")]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": str(SOURCE)}, timeout=120
    )
    assert done.returncode == 1
    assert "merged.bag: there is no space for it (File too large after " in done.stderr
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_an_input_that_is_cut_while_it_is_merged_is_an_error(tmp_path, inputs, monkeypatch):
    monkeypatch.setattr(merge_module, "GROUP_BYTES", 100_000)
    source = tmp_path / "1.bag"
    shutil.copy(inputs[0], source)

    def cut(_done, _total):
        os.truncate(source, 100_000)

    with pytest.raises(BagError, match=r"1\.bag: "):
        merge([source, inputs[1]], tmp_path / "merged.bag", progress=cut)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["1.bag"]
