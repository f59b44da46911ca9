"""The autopilot node and the mission planner, and their ways to the vehicle."""
