"""What watchdog, landing detection, state estimation and battery check compute: samples in, verdicts out. Pure."""
