"""The autonomy node: the engine's thread, what comes in, what goes out, and the folder of a run."""
