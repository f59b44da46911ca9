"""The command `amaze-bag`: what it says and its exit status."""

from __future__ import annotations

import errno
import json
import os
import random
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from bag_tools import COMPRESSIONS, MS, bag, digest, ending, every_kill, multiset, rows, text, unclosed
from replay_bags import START_NS, write_bag

from amaze_autonomy.bags.arrays import index_records
from amaze_autonomy.bags.cli import main
from amaze_autonomy.bags.format import Connection, message_fields, pack_field
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge.manifest import manifest_path
from amaze_autonomy.bags.write import Output

ROOT = Path(__file__).parents[2]
STRING = "992ce8a1687cec8c8bd883ec73ca41d1"  # the md5 of std_msgs/String


@pytest.fixture
def two(tmp_path):
    return [
        str(bag(tmp_path / "main.bag", rows("/a", 60), rows("/rosout", 20, caller="/n"))),
        str(bag(tmp_path / "camera.bag", rows("/b", 40), rows("/rosout", 20, caller="/n"))),
    ]


def run(capsys, *arguments):
    status = main(list(map(str, arguments)))
    said = capsys.readouterr()
    return status, said.out, said.err


def test_info_shows_counts_rates_and_gaps(capsys, two):
    status, out, err = run(capsys, "info", two[0])
    assert (status, err) == (0, "")
    assert out.splitlines() == [
        two[0],
        "  80 messages, 0.59 s from 2020-09-13 12:26:40 UTC to 2020-09-13 12:26:40 UTC; 0.0 MB; version 2.0",
        "  chunks: 4 none",
        f"  /a       std_msgs/String         60   100.00 Hz   longest gap 0.010 s   {STRING}",
        f"  /rosout  std_msgs/String         20   100.00 Hz   longest gap 0.400 s   {STRING}",
    ]
    status, out, _ = run(capsys, "info", *two, "--json")
    assert [bag["messages"] for bag in json.loads(out)] == [80, 60]


def test_info_says_how_much_is_compressed(capsys, tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 400), compression="bz2", chunk_bytes=9000)
    (found,) = json.loads(run(capsys, "info", source, "--json")[1])
    known = found["compression"]["bz2"]
    with Index(source) as index:
        heads = [index.head(number) for number in range(len(index.chunks))]
    expected = {"chunks": len(heads), "stored": sum(e.stored for e in heads), "size": sum(e.size for e in heads)}
    assert (known, found["chunks"], found["types"]) == (expected, {"bz2": len(heads)}, {"std_msgs/String": STRING})
    assert (
        f"  chunks: {len(heads)} bz2 ({known['stored'] / known['size']:.1%} of 0.0 MB)"
        in run(capsys, "info", source)[1]
    )


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_info_of_a_bag_that_was_not_closed_is_that_of_its_chunks(capsys, tmp_path, compression):
    source = bag(tmp_path / "1.bag", rows("/a", 200), rows("/b", 50, 31), compression=compression)
    active = unclosed(source, tmp_path / "1.bag.active")
    assert run(capsys, "recover", active, "-o", tmp_path / "2.bag")[0] in {0, 3}
    whole = json.loads(run(capsys, "info", tmp_path / "2.bag", "--json")[1])[0]
    status, out, err = run(capsys, "info", active, "--json")
    found = json.loads(out)[0]
    assert (status, err, found["closed"], found["problem"]) == (0, "", False, "was not closed, so it has no index")
    same = ("messages", "start_ns", "end_ns", "types", "topics")
    assert [found[name] for name in same] == [whole[name] for name in same]
    assert "  was not closed, so it has no index: this is what is in its chunks\n" in run(capsys, "info", active)[1]


def test_info_counts_messages_whose_connection_is_described_nowhere(capsys, tmp_path):
    """One wrong byte in a compressed chunk: what it describes cannot be read, and its index names it all the same."""
    source = bag(tmp_path / "1.bag", rows("/a", 200), rows("/b", 50, 31), compression="lz4")
    active = unclosed(source, tmp_path / "1.bag.active")
    with Index(source) as index:
        place = index.head(0).data + 40
    raw = bytearray(active.read_bytes())
    raw[place] ^= 1
    active.write_bytes(raw)
    status, out, err = run(capsys, "info", active, "--json")
    found = json.loads(out)[0]
    assert (status in {0, 3}, err, found["closed"]) == (True, "", False)
    assert sum(topic["messages"] for topic in found["topics"]) <= found["messages"]


def test_info_of_a_bag_with_a_damaged_index_is_that_of_its_chunks_and_ends_with_damage(capsys, tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 200))
    source.write_bytes(source.read_bytes()[:-100])
    status, out, err = run(capsys, "info", source)
    assert (status, err) == (3, "")
    assert out.splitlines()[1].startswith("  200 messages, ")
    assert out.splitlines()[3].startswith("  the index is damaged (")


@pytest.mark.parametrize("command", ["info", "doctor"])
def test_what_looks_goes_on_after_a_bad_file(capsys, tmp_path, two, command):
    (tmp_path / "bad.bag").write_bytes(b"no bag at all")
    (tmp_path / "empty.bag").touch()
    status, out, err = run(capsys, command, tmp_path / "bad.bag", two[0], tmp_path / "empty.bag", two[1])
    assert status == 1
    assert [line.split(":")[0] for line in out.splitlines() if str(tmp_path) in line] == two
    assert [line.split("; ")[0] for line in err.splitlines()] == [
        f"amaze-bag: {tmp_path / 'bad.bag'}: is no bag",
        f"amaze-bag: {tmp_path / 'empty.bag'}: is empty",
    ]
    out = run(capsys, command, "--json", tmp_path / "bad.bag", two[0])[1]
    assert ["error" in each for each in json.loads(out)] == [True, False]


def test_names_that_would_move_the_cursor_are_shown_with_escapes(capsys, tmp_path):
    source = bag(tmp_path / "1.bag", rows("/odd_name", 5))
    source.write_bytes(source.read_bytes().replace(b"/odd_name", b"/\x1b[2J\r\n\xc2\x9b"))
    out = run(capsys, "info", source)[1]
    assert "/\\x1b[2J\\r\\n\\x9b" in out
    assert len(out.splitlines()) == 4


def test_a_bag_whose_line_endings_git_converted_is_recognised(capsys, two, tmp_path):
    converted = tmp_path / "converted.bag"
    converted.write_bytes(Path(two[0]).read_bytes().replace(b"\n", b"\r\n"))
    for command in ("info", "doctor", "recover"):
        status, _, err = run(capsys, command, converted)
        assert status == 1
        assert "its line endings were converted (git does that unless .gitattributes says `*.bag -text`)" in err


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_bag_whose_line_endings_git_converted_the_other_way_is_recognised(capsys, tmp_path, compression):
    noise = random.Random(1)
    ends = ("\r\n", "\n", "")
    said = [(START_NS + n, "/a", text(f"{n}{ends[n % 3]}{noise.getrandbits(4000)}")) for n in range(40)]
    lines = bag(tmp_path / "lines.bag", said, compression=compression)
    whole = lines.read_bytes()
    if b"\r\n" not in whole:  # compressed, there may be none
        half = len(whole) // 4
        whole = whole[:half] + b"\r\n" + whole[half + 2 :]
    converted = tmp_path / "converted.bag"
    converted.write_bytes(whole.replace(b"\r\n", b"\n"))
    words = "git's conversion of line endings made every CR LF an LF"
    status, out, _ = run(capsys, "info", converted)
    assert (status, words in out) == (3, True)
    for command in ("doctor", "recover"):
        status, out, _ = run(capsys, command, converted)
        assert (status, words in out) == (3, True)
    assert not multiset(tmp_path / "converted.recovered.bag") - multiset(lines)
    status, _, err = run(capsys, "merge", converted, lines, "-o", tmp_path / "merged.bag")
    assert (status, words in err, "`*.bag binary`" in err) == (1, True, True)


@pytest.mark.parametrize("size", [-1, -100, -3000])
def test_a_bag_without_line_endings_that_is_cut_was_not_converted(capsys, two, size):
    Path(two[0]).write_bytes(Path(two[0]).read_bytes()[:size])
    assert "line endings" not in "".join(run(capsys, "doctor", two[0])[1:])


def test_very_many_connections_are_told_apart(capsys, tmp_path):
    source, many = tmp_path / "many.bag", 3000
    header = b"".join(
        pack_field(*each) for each in ((b"type", b"a/B"), (b"md5sum", b"0" * 32), (b"message_definition", b"x"))
    )
    connections = {
        number: Connection(number, f"/{number}", "a/B", "0" * 32, "", False, header) for number in range(many)
    }
    records = [
        len(fields).to_bytes(4, "little") + fields + bytes(4)
        for fields in (message_fields(number, START_NS + number) for number in range(many))
    ]
    data, size = b"".join(records), len(records[0])
    numbers = np.arange(many)
    with Output(source) as out:
        index = index_records(START_NS + numbers, numbers, size * numbers)
        counts = [(number, 1) for number in range(many)]
        out.chunk("none", len(data), [data], index, times=(START_NS, START_NS + many - 1), counts=counts)
        out.close(connections)
    (found,) = json.loads(run(capsys, "info", "--json", source)[1])
    assert found["messages"] == len(found["topics"]) == many
    assert run(capsys, "merge", source, source, "-o", tmp_path / "2.bag", "--verify", "--readers", "none")[0] == 0
    assert run(capsys, "doctor", tmp_path / "2.bag")[0] == 0


def test_doctor_says_where_it_is_damaged(capsys, tmp_path, two):
    assert run(capsys, "doctor", *two)[0] == 0
    cut = tmp_path / "cut.bag"
    cut.write_bytes(Path(two[0]).read_bytes()[:-10])
    status, out, _ = run(capsys, "doctor", cut)
    size = cut.stat().st_size
    assert status == 3
    assert out.splitlines()[0] == f"{cut}: 80 messages in 4 chunks; lost: 0 messages"
    assert out.splitlines()[1].endswith(f" to {size}: the index is damaged or cut")
    status, out, _ = run(capsys, "doctor", "--quick", "--json", cut)
    assert (status, json.loads(out)[0]["closed"], json.loads(out)[0]["lost"]) == (3, False, 0)


@pytest.mark.parametrize("chunk_bytes", [300, 100_000])
def test_doctor_says_that_a_clock_was_set_back(capsys, tmp_path, chunk_bytes):
    later = [(t_ns - 500 * MS, *rest) for t_ns, *rest in rows("/a", 100, first_ms=1000)]
    source = write_bag(tmp_path / "set.bag", [*rows("/a", 100), *later], chunk_bytes=chunk_bytes)
    active = unclosed(source, tmp_path / "set.bag.active")
    words = (
        "its clock was set back by 0.490 s or more at +0.990 s: what was recorded before and after lies at the same "
        "times, from +0.500 s on, where no silence can be seen"
    )
    status, out, _ = run(capsys, "doctor", source)
    lines = out.splitlines()
    assert (status, lines[0].split(";")[1], lines[1:]) == (3, " lost: 0 messages", [f"  {words}"])
    status, out, _ = run(capsys, "doctor", active)
    assert (status, out.splitlines()[-1]) == (3, f"  {words}")
    (found,) = json.loads(run(capsys, "doctor", "--json", source)[1])
    assert (found["clock_set_back_s"], found["damages"]) == (0.49, [])
    (found,) = json.loads(run(capsys, "doctor", "--json", write_bag(tmp_path / "good.bag", rows("/a", 100)))[1])
    assert found["clock_set_back_s"] is None


def test_recover_says_what_was_lost(capsys, tmp_path, two):
    active = unclosed(Path(two[0]), tmp_path / "flight.bag.active", 30)
    status, out, _ = run(capsys, "recover", active)
    assert status == 3
    assert out.startswith(f"{tmp_path / 'flight.bag'}: ")
    assert "lost: an unknown number of messages" in out
    there = "exists; choose another name, or say that it may be replaced (--force)\n"
    for command in (("recover", active), ("cut", two[0], "-o", tmp_path / "flight.bag", "--to", 0.1)):
        assert run(capsys, *command)[::2] == (1, f"amaze-bag: {tmp_path / 'flight.bag'}: {there}")
    for force in ((), ("--force",)):
        said = f"amaze-bag: {tmp_path}: is a folder; name a file, in it or elsewhere\n"
        assert run(capsys, "recover", active, "-o", tmp_path, *force) == (1, "", said)
    whole = unclosed(Path(two[0]), tmp_path / "whole.bag.active")
    status, out, _ = run(capsys, "recover", whole, "--json")
    assert (status, json.loads(out)["messages"], json.loads(out)["lost"]) == (0, 80, 0)


def test_a_merge_replaces_no_file_that_is_called_as_its_manifest_and_is_none(capsys, tmp_path, two):
    output = tmp_path / "flight.bag"
    other = manifest_path(output)
    other.write_text("a shopping list\n")
    said = f"amaze-bag: {other}: is no manifest, and would be replaced; name another file with -o\n"
    assert run(capsys, "merge", *two, "-o", output) == (1, "", said)
    assert (other.read_text(), output.exists()) == ("a shopping list\n", False)
    other.unlink()
    for _ in range(2):
        assert run(capsys, "merge", *two, "-o", output)[0] == 0
        output.unlink()


def test_a_bag_without_an_ending_takes_not_the_manifest_of_the_one_with_it(capsys, tmp_path, two):
    flight, other = tmp_path / "flight.bag", tmp_path / "flight"
    assert run(capsys, "merge", *two, "-o", flight, "--verify", "--readers", "none")[0] == 0
    kept = manifest_path(flight).read_bytes()
    wrong = "is the manifest of flight.bag, and would be that of flight; give one of the two another name"
    said = (1, "", f"amaze-bag: {manifest_path(flight)}: {wrong}\n")
    for force in ((), ("--force",)):
        assert run(capsys, "merge", two[0], "-o", other, *force) == said
        assert not other.exists()
    assert run(capsys, "cut", two[0], "-o", other, "--to", 0.1)[0] == 0
    assert run(capsys, "cut", two[0], "-o", other, "--to", 0.1, "--force")[0] == 0
    assert run(capsys, "verify", other) == run(capsys, "verify", other, two[0]) == said
    assert manifest_path(flight).read_bytes() == kept
    flight.rename(tmp_path / "x.bag")
    manifest_path(flight).rename(tmp_path / "x.manifest.json")
    assert run(capsys, "verify", tmp_path / "x.bag", "--readers", "none")[0] == 0, "it was given another name"


def test_merge_verify_and_the_manifest(capsys, tmp_path, two):
    output = tmp_path / "flight.bag"
    status, out, _ = run(capsys, "merge", *two, "-o", output, "--duplicates", "drop", "--verify")
    assert status == 0
    assert out.splitlines()[:3] == [
        f"{output}: 120 messages, {output.stat().st_size / 1e6:.1f} MB",
        "  warning: /rosout: 20 messages are in several inputs, dropped",
        f"{output}: 120 messages of 2 inputs: verified",
    ]
    manifest = json.loads((tmp_path / "flight.manifest.json").read_text())
    assert manifest["verified"]["ok"] is True
    assert manifest["verified"]["readers"]["rosbags"] == "agrees"
    assert [entry["file"] for entry in manifest["inputs"]] == ["main.bag", "camera.bag"]
    assert [entry["sha256"] for entry in manifest["inputs"]] == [digest(path) for path in two]
    assert manifest["output"]["sha256"] == digest(output)
    assert manifest["output"]["messages"] == 120
    assert run(capsys, "verify", output, "--readers", "none")[0] == 0


def test_verify_finds_what_is_missing(capsys, tmp_path, two):
    output = tmp_path / "flight.bag"
    assert run(capsys, "merge", *two, "-o", output)[0] == 0
    shutil.copy(two[0], output)
    status, out, _ = run(capsys, "verify", output, "--readers", "none")
    assert status == 3
    assert out.splitlines()[1:] == [
        "  problem: /b (std_msgs/String) has 0 messages instead of 40",
        "  problem: /rosout (std_msgs/String) has 20 messages instead of 40",
    ]
    verdict = json.loads(manifest_path(output).read_text())["verified"]
    assert (verdict["ok"], len(verdict["problems"])) == (False, 2)


def test_verify_finds_one_wrong_byte_and_one_wrong_time(capsys, tmp_path, two):
    output = tmp_path / "flight.bag"
    run(capsys, "merge", *two, "-o", output)
    good = output.read_bytes()
    at = good.index(b"/b 7 ") + 3
    output.write_bytes(good[:at] + b"8" + good[at + 1 :])
    status, out, _ = run(capsys, "verify", output, "--readers", "none")
    assert (status, out.splitlines()[1]) == (
        3,
        "  problem: /b (std_msgs/String) has messages with other bytes or times than its inputs",
    )


def repeating(path, first, last, after_ms=0):
    """Write a bag of a publisher that says the same each time."""
    times = [START_NS + (each * 100 + after_ms) * MS for each in range(first, last)]
    return bag(path, [(t_ns, "/armed", text("yes"), "/n") for t_ns in times])


def test_merge_is_told_whose_files_its_inputs_are(capsys, tmp_path):
    """What is said at the end of one file and again in the next one was published twice; a camera recorded it, too."""
    files = [repeating(tmp_path / "main_0.bag", 0, 10), repeating(tmp_path / "main_1.bag", 10, 20)]
    files.append(repeating(tmp_path / "camera.bag", 5, 15, after_ms=2))
    output, dropping = tmp_path / "flight.bag", ("--duplicates", "drop", "--verify", "--readers", "none")
    assert run(capsys, "merge", *files, "-o", output, *dropping, "--origins", "main,main,camera")[0] == 0
    assert multiset(output) == multiset(*files[:2])
    manifest = json.loads(manifest_path(output).read_text())
    assert [entry["origin"] for entry in manifest["inputs"]] == [0, 0, 1]
    assert run(capsys, "merge", *files, "-o", output, *dropping, "--force")[0] == 0
    assert sum(multiset(output).values()) < 20
    assert run(capsys, "merge", *files, "-o", output, "--force", "--origins", "main,camera")[::2] == (
        1,
        "amaze-bag: --origins: 2 origins for 3 inputs; give one each\n",
    )


def test_offsets_are_applied_and_remembered(capsys, tmp_path, two):
    output = tmp_path / "flight.bag"
    assert run(capsys, "merge", *two, "-o", output, "--offsets-s", "0,-3.02")[0] == 0
    assert run(capsys, "verify", output, "--readers", "none")[0] == 0
    assert run(capsys, "verify", output, *two, "--readers", "none")[0] == 0
    entries = json.loads(manifest_path(output).read_text())["inputs"]
    assert [entry["offset_ns"] for entry in entries] == [0, -3_020_000_000]
    assert run(capsys, "merge", *two, "-o", output, "--offsets-s", "1")[::2] == (
        1,
        "amaze-bag: --offsets-s: 1 offsets for 2 inputs; give one each\n",
    )


def test_offsets_that_a_bag_was_verified_with_are_those_of_its_new_manifest(capsys, tmp_path, two):
    output = tmp_path / "flight.bag"
    assert run(capsys, "merge", *two, "-o", output, "--offsets-s", "0,-3.02")[0] == 0
    manifest_path(output).unlink()
    assert run(capsys, "verify", output, *two, "--offsets-s", "0,-3.02", "--readers", "none")[0] == 0
    entries = json.loads(manifest_path(output).read_text())["inputs"]
    assert [entry["offset_ns"] for entry in entries] == [0, -3_020_000_000]
    assert run(capsys, "verify", output, "--readers", "none")[0] == 0
    assert run(capsys, "verify", output, *two, "--offsets-s", "0,1", "--readers", "none")[0] == 3
    assert run(capsys, "verify", output, "--offsets-s", "0,-3.02", "--readers", "none")[0] == 0


def test_inputs_may_be_named_in_any_order_and_may_have_been_moved(capsys, tmp_path, two):
    output = tmp_path / "flight.bag"
    assert run(capsys, "merge", *two, two[0], "-o", output, "--offsets-s", "0,-3.02,5")[0] == 0
    (tmp_path / "moved").mkdir()
    moved = [shutil.copy(path, tmp_path / "moved") for path in two]
    manifest = manifest_path(output).read_bytes()
    for inputs in ([two[1], two[0], two[0]], [two[0], two[0], two[1]], [*moved, moved[0]]):
        manifest_path(output).write_bytes(manifest)
        status, out, _ = run(capsys, "verify", output, *inputs, "--readers", "none")
        assert (status, out) == (0, f"{output}: 220 messages of 3 inputs: verified\n")


def other_inputs(tmp_path, two):
    """Name, for a verified merge of two, inputs that are not those: one, one more, and one that is another one now."""
    more = bag(tmp_path / "more.bag", rows("/c", 5))
    other, changed = "is of other inputs", "camera.bag is not what it was when this was verified, and flight.bag is"
    yield two[:1], other
    yield [*two, more], other
    yield [two[0], two[0]], other
    Path(two[1]).unlink()
    bag(Path(two[1]), rows("/b", 30))
    yield two, changed
    yield [], changed


def test_a_verdict_on_other_inputs_is_shown_and_leaves_the_manifest_as_it_is(capsys, tmp_path, two):
    """Whoever goes on with a recording finds in it what that was made of, and whether it can be made again."""
    output = tmp_path / "flight.bag"
    assert run(capsys, "merge", *two, "-o", output, "--verify")[0] == 0
    before = manifest_path(output).read_bytes()
    for inputs, said in other_inputs(tmp_path, two):
        status, out, err = run(capsys, "verify", output, *inputs, "--readers", "none")
        assert (status, out.splitlines()[0][-8:]) == (3, "problems")
        assert err == f"amaze-bag: {manifest_path(output)}: {said}; the verdict was not written into it\n"
        assert manifest_path(output).read_bytes() == before


def test_a_verdict_on_copies_of_the_inputs_is_kept_and_not_where_these_lie(capsys, tmp_path, two):
    """The places that a manifest names are those that whoever goes on with a recording looks at."""
    output = tmp_path / "flight.bag"
    (tmp_path / "copies").mkdir()
    shutil.copy(two[0], tmp_path / "twin.bag")
    inputs = [*two, tmp_path / "twin.bag"]
    copies = [shutil.copy(path, tmp_path / "copies") for path in inputs]
    assert run(capsys, "merge", *inputs, "-o", output, "--verify")[0] == 0
    before = json.loads(manifest_path(output).read_text())
    good = output.read_bytes()
    for content, status in ((good.replace(b"/b 7 ", b"/b 8 "), 3), (good, 0)):
        output.write_bytes(content)
        assert run(capsys, "verify", output, *copies, "--readers", "none")[::2] == (status, "")
        after = json.loads(manifest_path(output).read_text())
        assert (after["verified"]["ok"], after["inputs"]) == (status == 0, before["inputs"])


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("duplicates", ["count", "drop"])
def test_a_verified_bag_whose_inputs_are_gone_is_compared_with_its_manifest(capsys, tmp_path, two, duplicates):
    """`keep_parts: false` removes them on purpose."""
    output = tmp_path / "flight.bag"
    assert run(capsys, "merge", *two, "-o", output, "--duplicates", duplicates, "--verify")[0] == 0
    before, good = manifest_path(output).read_bytes(), output.read_bytes()
    Path(two[0]).unlink()
    count = 120 if duplicates == "drop" else 140
    gone = "  inputs that cannot be found: main.bag; compared with what the manifest says since it was verified"
    verified = [f"{output}: {count} messages: verified", gone, f"  rosbags: {count} messages"]
    assert run(capsys, "verify", output)[1].splitlines()[:3] == verified
    status, out, err = run(capsys, "verify", output, "--readers", "none", "--json")
    shown, manifest = json.loads(out), json.loads(before)
    assert (status, err, shown["verified"]["ok"], shown["gone"]) == (0, "", True, ["main.bag"])
    assert shown["inputs"] == manifest["inputs"]
    other, unseen = (good.replace(old, new) for old, new in ((b"/b 7 ", b"/b 8 "), (b" " * 64, b" " * 63 + b"_")))
    for content, wrong in (
        (other, "/b (std_msgs/String) has messages with other bytes or times than its inputs"),
        (unseen, "it is not the file that was verified: its sha256 is another one"),
    ):
        output.write_bytes(content)
        status, out, _ = run(capsys, "verify", output, "--readers", "none")
        assert (status, out.splitlines()[1:]) == (3, [f"  problem: {wrong}", gone])
    assert manifest_path(output).read_bytes() == before


@pytest.mark.parametrize("intact", [True, False])
def test_an_input_that_changed_is_named_and_not_the_recording(capsys, tmp_path, two, intact):
    output = tmp_path / "flight.bag"
    assert run(capsys, "merge", *two, "-o", output, "--verify")[0] == 0
    before = manifest_path(output).read_bytes()
    Path(two[0]).write_bytes(Path(two[0]).read_bytes().replace(b"/a 7 ", b"/a 8 "))
    if not intact:
        output.write_bytes(output.read_bytes().replace(b"/b 7 ", b"/b 8 "))
    status, _, err = run(capsys, "verify", output, "--readers", "none")
    said = "main.bag is not what it was when this was verified" + ", and flight.bag is" * intact
    expected = f"amaze-bag: {manifest_path(output)}: {said}; the verdict was not written into it\n"
    assert (status, err) == (3, expected)
    assert manifest_path(output).read_bytes() == before


def test_a_bag_whose_inputs_are_gone_and_that_was_not_verified_cannot_be(capsys, tmp_path, two):
    output = tmp_path / "flight.bag"
    assert run(capsys, "merge", *two, "-o", output)[0] == 0
    Path(two[0]).unlink()
    assert run(capsys, "verify", output)[::2] == (
        1,
        f"amaze-bag: {two[0]}: cannot be read (No such file or directory); name a bag that you may read\n",
    )


@pytest.mark.parametrize("good", [True, False])
def test_a_verdict_that_cannot_be_written_is_shown(capsys, tmp_path, two, monkeypatch, good):
    output = tmp_path / "flight.bag"
    assert run(capsys, "merge", *two, "-o", output)[0] == 0
    before = manifest_path(output).read_bytes()
    shutil.copy(output if good else two[0], tmp_path / "other.bag")
    (tmp_path / "other.bag").replace(output)

    def full(path, _):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    monkeypatch.setattr("amaze_autonomy.bags.merge.manifest.write_whole", full)
    status, out, err = run(capsys, "verify", output, "--readers", "none")
    assert status == (0 if good else 3)
    assert out.splitlines()[0].endswith("of 2 inputs: verified" if good else "of 2 inputs: 2 problems")
    wrong = "Read-only file system; the verdict was not written into it"
    assert err == f"amaze-bag: {manifest_path(output)}: {wrong}\n"
    assert manifest_path(output).read_bytes() == before


@pytest.mark.parametrize("module", ["", "__init__.py"])
def test_a_folder_that_is_called_as_a_reader_is_no_reader(capsys, tmp_path, two, monkeypatch, module):
    for name in ("rosbag", "rosbags"):
        (tmp_path / name).mkdir()
        if module:
            (tmp_path / name / module).write_text("raise RuntimeError('not this one')")
    monkeypatch.chdir(tmp_path)
    status, out, _ = run(capsys, "merge", *(Path(path).name for path in two), "-o", "flight.bag", "--verify")
    assert (status, "  rosbags: 140 messages" in out.splitlines()) == (0, True)


def test_all_readers_read_every_message(capsys, tmp_path, two):
    output = tmp_path / "flight.bag"
    status, out, _ = run(capsys, "merge", *two, "-o", output, "--verify", "--readers", "read")
    assert status == 0
    readers = [line.strip() for line in out.splitlines()[2:] if not line.startswith("  warning")]
    assert "rosbags: 140 messages" in readers
    if shutil.which("rosbag"):
        assert readers[-3:] == ["rosbags: 140 messages", "rosbag: 140 messages", "librosbag: 140 messages"]


@pytest.mark.parametrize(
    "arguments", [[], ["fly"], ["merge", "a.bag"], ["merge", "-o", "x", "a", "--offsets-s", "soon"]]
)
def test_wrong_use_is_status_two(capsys, arguments):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert "usage: amaze-bag" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["info", "doctor", "recover", "merge", "verify"])
def test_every_command_has_help_with_examples(capsys, name):
    with pytest.raises(SystemExit) as caught:
        main([name, "--help"])
    said = capsys.readouterr().out
    assert caught.value.code == 0
    assert f"examples:\n  amaze-bag {name} " in said
    assert "exit status:" in said


@pytest.mark.parametrize("command", ["info", "doctor", "recover", "verify"])
def test_what_is_not_there_is_one_line(capsys, tmp_path, command):
    status, out, err = run(capsys, command, tmp_path / "none.bag")
    assert (status, out) == (1, "")
    wrong = "cannot be read (No such file or directory); name a bag that you may read"
    assert err == f"amaze-bag: {tmp_path / 'none.bag'}: {wrong}\n"


def test_a_topic_that_is_not_utf_8_is_shown_merged_and_verified(capsys, tmp_path):
    source = bag(tmp_path / "1.bag", rows("/odd", 5))
    source.write_bytes(source.read_bytes().replace(b"/odd", b"/\xe9\xe8d"))
    status, out, _ = run(capsys, "info", source)
    assert (status, "/_xe9_xe8d" in out) == (0, True)
    assert run(capsys, "merge", source, "-o", tmp_path / "m.bag", "--verify")[0] == 0


def test_the_script_starts_it():
    assert (ROOT / "scripts" / "amaze-bag").read_text().splitlines() == [
        "#!/usr/bin/env python3",
        "from amaze_autonomy.start import amaze_bag",
        "raise SystemExit(amaze_bag())",
    ]


def test_the_inputs_stay_as_they_are(capsys, tmp_path, two):
    before = [digest(path) for path in two]
    run(capsys, "merge", *two, "-o", tmp_path / "m.bag", "--verify", "--readers", "none")
    assert [digest(path) for path in two] == before
    assert multiset(tmp_path / "m.bag") == multiset(*two)


@pytest.mark.parametrize(
    "arguments",
    [["info"], ["doctor"], ["recover"], ["recover", "--in-place"], ["recover", "--undo"], ["verify"], ["merge", "-o"]],
)
@pytest.mark.parametrize("folder", [".", "/"])
def test_a_folder_is_no_bag(capsys, two, arguments, folder):
    more = two if arguments[0] == "merge" else []
    expected = f"amaze-bag: {folder}: is a folder; name a bag in it\n"
    assert run(capsys, *arguments, folder, *more) == (1, "", expected)


@pytest.mark.parametrize(
    "arguments",
    [
        ["info"], ["doctor"], ["recover"], ["recover", "--in-place"], ["verify"],
        ["merge", "-o", "m.bag"], ["cut", "--to", "1", "-o", "m.bag"],
    ],
)  # fmt: skip
def test_a_pipe_is_no_bag_and_nobody_waits_for_what_comes_out_of_it(capsys, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("x.bag")
    with ending():
        assert run(capsys, *arguments, "x.bag") == (1, "", "amaze-bag: x.bag: is a pipe; copy it into a file first\n")
    assert [path.name for path in tmp_path.iterdir()] == ["x.bag"]


@pytest.mark.parametrize("command", ["merge", "cut", "recover"])
@pytest.mark.parametrize("force", [(), ("--force",)])
def test_a_device_or_a_pipe_is_replaced_by_no_bag(capsys, tmp_path, two, command, force):
    output = tmp_path / "null"
    os.mkfifo(output)
    more = ("--to", 0.1) if command == "cut" else ()
    said = f"amaze-bag: {output}: is a device or a pipe; name a file\n"
    assert run(capsys, command, two[0], "-o", output, *more, *force) == (1, "", said)
    assert [path.name for path in tmp_path.iterdir() if path.is_fifo()] == ["null"]


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize(
    "command", [["filter", "--to", "0.5"], ["cut", "--to", "0.5"], ["recover"], ["merge", "--duplicates", "drop"]]
)
def test_the_manifest_of_a_bag_that_is_replaced_goes_with_it(capsys, tmp_path, two, command):
    output = tmp_path / "out.bag"
    assert run(capsys, "merge", *two, "-o", output, "--verify")[0] == 0
    assert manifest_path(output).is_file()
    status, _, said = run(capsys, *command, two[0], "-o", output)
    assert status == 1
    assert "exists" in said
    assert manifest_path(output).is_file()
    assert run(capsys, *command, two[0], "-o", output, "--force")[0] == 0
    assert manifest_path(output).is_file() is (command[0] == "merge")
    assert run(capsys, "verify", output)[0] == 0


def test_a_merge_that_is_killed_leaves_no_bag_with_the_manifest_of_another(capsys, tmp_path, two):
    output, manifest, first = tmp_path / "out.bag", manifest_path(tmp_path / "out.bag"), []
    for arguments in (["--offsets-s", "0,5"], []):
        assert run(capsys, "merge", *two, "-o", output, "--force", *arguments)[0] == 0
        first.append((output.read_bytes(), manifest.read_bytes()))
    (old, old_manifest), (new, new_manifest) = first
    states = set()

    def begin():
        output.write_bytes(old)
        manifest.write_bytes(old_manifest)

    begin()
    for call in every_kill(lambda: main(["merge", *map(str, two), "-o", str(output), "--force"])):
        assert output.read_bytes() in (old, new), call
        beside = manifest.read_bytes() if manifest.exists() else None
        assert beside in (None, old_manifest if output.read_bytes() == old else new_manifest), call
        states.add((output.read_bytes() == old, beside))
        begin()
    between = {(True, None)} if sys.version_info >= (3, 10) else set()  # before, pathlib's own calls are not seen
    assert states >= {(True, old_manifest), (False, None), *between}
    assert (output.read_bytes(), manifest.read_bytes()) == (new, new_manifest)
