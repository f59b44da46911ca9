"""`./run advisories`: what its exit status says of what pip-audit says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FAULT = {"id": "PYSEC-2021-142", "aliases": ["CVE-2020-14343"], "fix_versions": ["5.4"]}
LOWEST = ["PyYAML==5.3", "lz4==3.1"]


@pytest.fixture
def advisories(tmp_path):
    """Run it with a pip-audit that says the same of each package, but for those that are named."""

    def run(**of_one) -> subprocess.CompletedProcess:
        auditor = tmp_path / "pip-audit"
        auditor.write_text(
            "#!/usr/bin/env python3\nimport json, pathlib, sys\nrows = []\n"
            "for line in pathlib.Path(sys.argv[-1]).read_text().split():\n"
            "    name, _, version = line.partition('==')\n"
            f"    answer = {of_one!r}.get(name, {{'version': version, 'vulns': []}})\n"
            "    rows.append({'name': name, **answer})\n"
            "print(json.dumps({'dependencies': rows}))\n"
            "sys.exit(any(row.get('vulns') for row in rows))\n"
        )
        auditor.chmod(0o755)
        command = [sys.executable, str(ROOT / "release" / "advisories.py"), str(auditor), *LOWEST]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)

    return run


def test_none_is_known_when_each_package_was_asked_about(advisories):
    result = advisories()

    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.splitlines()[1] == "lowest: 0 known of 2 of 2 packages: PyYAML==5.3 lz4==3.1"


def test_each_that_is_known_is_a_line_with_its_names_and_what_corrects_it(advisories):
    result = advisories(PyYAML={"version": "5.3", "vulns": [FAULT]})

    assert (result.returncode, result.stderr) == (1, "")
    assert result.stdout.splitlines()[2] == "  PyYAML 5.3: PYSEC-2021-142 CVE-2020-14343; corrected in 5.4"


def test_a_package_that_the_service_does_not_know_was_not_asked_about(advisories):
    result = advisories(lz4={"skip_reason": "Dependency not found on PyPI and could not be audited: lz4 (3.1)"})

    assert result.returncode == 3
    assert result.stderr == "here: nobody could be asked about 1 of them\n"


def test_a_service_that_does_not_answer_is_no_finding(tmp_path):
    auditor = tmp_path / "pip-audit"
    auditor.write_text("#!/bin/sh\necho 'ERROR: connection refused' >&2\nexit 1\n")
    auditor.chmod(0o755)

    command = [sys.executable, str(ROOT / "release" / "advisories.py"), str(auditor), *LOWEST]
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)

    assert result.returncode == 3
    assert result.stderr.splitlines()[0] == "ERROR: connection refused"
