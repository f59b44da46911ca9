"""The simulated sensors: when samples come, what they read, and as which messages."""
