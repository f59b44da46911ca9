"""Autonomy engine for multicopters with a PX4 autopilot, live under ROS 1 and offline on recordings."""
