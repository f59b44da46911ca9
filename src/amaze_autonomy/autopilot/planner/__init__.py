"""Missions to the vehicle, and how they are flown: the mission planner and sequencer."""
