"""Makes the helpers of other folders importable: they write, or find, what the documentation names."""

import sys
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("autopilot", "cns", "replay")]
