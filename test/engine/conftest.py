"""Makes the helpers of this folder importable; the laws of the engine watch every story."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))

import engine_laws
import engine_story

engine_story.ALWAYS.append(engine_laws.watch)
