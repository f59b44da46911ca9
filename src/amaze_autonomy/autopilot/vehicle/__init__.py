"""What the vehicle says of itself, and what the autopilot node asks of it."""
