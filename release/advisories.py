#!/usr/bin/env python3
"""What `./run advisories` asks: is an advisory known of what flying and the flight page require?

In the versions that are here, and in the lowest that pyproject.toml allows, which are given. pip-audit asks the Python
Packaging Advisory Database by way of PyPI. It takes a service that does not answer for a finding, and one that does not
know a package for none: here both are an answer that is missing.

usage: advisories.py PIP_AUDIT NAME==VERSION...
exit status: 0 none is known; 1 some are, each is a line; 3 about something nobody could be asked
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Dict, List, Sequence

from deb import required

NONE, SOME, NOBODY_ASKED = 0, 1, 3
_OPTIONS = ("--disable-pip", "--no-deps", "--progress-spinner", "off", "--format", "json", "--requirement")


def ask(auditor: str, versions: Sequence[str]) -> List[Dict[str, Any]]:
    """Ask about packages; return what pip-audit says of each, none where it says nothing that can be read."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "requirements.txt"
        file.write_text("".join(f"{each}\n" for each in versions))
        answer = subprocess.run([auditor, *_OPTIONS, str(file)], capture_output=True, text=True, check=False)
    try:
        return list(json.loads(answer.stdout)["dependencies"])
    except (ValueError, KeyError, TypeError):
        print(*answer.stderr.splitlines()[-3:], sep="\n", file=sys.stderr)
        return []


def main(auditor: str, lowest: Sequence[str]) -> int:
    """Ask about both, say what is known, and return the exit status."""
    here = [f"{name}=={found.version}" for name, found in sorted(required("amaze_autonomy", ["page"], {}).items())]
    status = NONE
    for which, versions in {"here": here, "lowest": lowest}.items():
        rows = ask(auditor, versions)
        known = [(row, each) for row in rows for each in row.get("vulns", ())]
        asked = sum("vulns" in row for row in rows)
        print(f"{which}: {len(known)} known of {asked} of {len(versions)} packages: {' '.join(versions)}")
        for row, each in known:
            names, corrected = [each["id"], *each.get("aliases", ())], each.get("fix_versions") or ["none"]
            print(f"  {row['name']} {row['version']}: {' '.join(names)}; corrected in {', '.join(corrected)}")
        status = NOBODY_ASKED if asked < len(versions) else max(status, SOME if known else NONE)
        if status == NOBODY_ASKED:
            print(f"{which}: nobody could be asked about {len(versions) - asked} of them", file=sys.stderr)
            break
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
