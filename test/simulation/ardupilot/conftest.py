"""Makes the tools of the neighbouring folder importable for these tests."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "px4"))
