"""The engine's peers in a replay: planner, recorder, vehicle, watchdog and checks, each value recorded or scripted."""
