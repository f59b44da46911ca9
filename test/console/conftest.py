"""Makes the scenes of this folder importable, for the tests and for the script that writes them."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
