"""Makes the helpers of this folder importable; each story watches the laws of the engine, and leaving early."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))

import engine_laws
import engine_settled
import engine_story

engine_story.ALWAYS.append(engine_laws.watch)
engine_story.ALWAYS.append(engine_settled.follow)
