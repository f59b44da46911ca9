"""What watchdog, landing detection, state estimation and battery checks compute: samples and times in, verdicts out.

Pure: no ROS, no clock, no I/O, no threads. The nodes feed it live, the replay from a bag, the simulation from a model.
"""

from __future__ import annotations

__all__: list[str] = []
