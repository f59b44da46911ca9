"""The engine's peers in the simulated world, and the switchboard that carries requests to them and replies back."""
