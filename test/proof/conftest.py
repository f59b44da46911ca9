"""Makes the modules of this folder importable, and those of test/engine that hold the tables written by hand."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
for folder in (HERE, HERE.parent / "engine"):
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
