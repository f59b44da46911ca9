"""Makes the modules of this folder importable, those of test/engine that hold the tables written by hand, and the
results of test/mutation, which the page shows."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
for folder in (HERE, HERE.parent / "engine", HERE.parent / "mutation"):
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
