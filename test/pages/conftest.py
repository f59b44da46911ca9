"""The bags that replays are tested with are at hand."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "replay"))
