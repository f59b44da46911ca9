"""The nodes that check: on the ground, and the states."""
