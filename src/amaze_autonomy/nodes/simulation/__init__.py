"""The simulated world and recorded peers as nodes."""
