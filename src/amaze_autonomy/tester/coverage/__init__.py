"""Is every row of the engine's tables tested: which fired in a suite, and which may be changed unnoticed."""
