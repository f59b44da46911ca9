"""Makes the tools of this folder importable for its tests."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
