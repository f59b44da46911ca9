"""The command `amaze-bag`: what it says and its exit status."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from bag_tools import bag, digest, multiset, rows, unclosed

from amaze_autonomy.bags.cli import main
from amaze_autonomy.bags.manifest import manifest_path

ROOT = Path(__file__).parents[2]


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
        "  80 messages, 0.59 s from 2020-09-13 12:26:40 UTC; 0.0 MB; chunks: 4 none",
        "  /a       std_msgs/String         60   100.00 Hz   longest gap 0.010 s",
        "  /rosout  std_msgs/String         20   100.00 Hz   longest gap 0.010 s",
    ]
    status, out, _ = run(capsys, "info", *two, "--json")
    assert [bag["messages"] for bag in json.loads(out)] == [80, 60]


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


def test_recover_says_what_was_lost(capsys, tmp_path, two):
    active = unclosed(Path(two[0]), tmp_path / "flight.bag.active", 30)
    status, out, _ = run(capsys, "recover", active)
    assert status == 3
    assert out.startswith(f"{tmp_path / 'flight.bag'}: ")
    assert "lost: an unknown number of messages" in out
    assert run(capsys, "recover", active)[::2] == (
        1,
        f"amaze-bag: {tmp_path / 'flight.bag'}: exists; choose another name, or say that it may be replaced\n",
    )
    whole = unclosed(Path(two[0]), tmp_path / "whole.bag.active")
    status, out, _ = run(capsys, "recover", whole, "--json")
    assert (status, json.loads(out)["messages"], json.loads(out)["lost"]) == (0, 80, 0)


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
    assert (status, "/\\udce9\\udce8d" in out) == (0, True)
    assert run(capsys, "merge", source, "-o", tmp_path / "m.bag", "--verify", "--readers", "none")[0] == 0


def test_the_script_starts_it():
    assert (ROOT / "scripts" / "amaze-bag").read_text().splitlines() == [
        "#!/usr/bin/env python3",
        "from amaze_autonomy.bags.cli import main",
        "raise SystemExit(main())",
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
