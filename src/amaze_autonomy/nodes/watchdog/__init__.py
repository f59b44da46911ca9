"""The watchdog node: counts, judges, says so, and restarts what may be restarted."""
