"""Makes the helpers importable, and behind all others those of test/autopilot: our planner with a simulated PX4."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE)]
sys.path.append(str(HERE.parent / "autopilot"))
