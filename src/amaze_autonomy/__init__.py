"""Autonomy engine for multicopters with a PX4 autopilot, live under ROS 1 and offline on recordings."""

from pkgutil import extend_path

__path__ = extend_path(__path__, __name__)  # the generated messages lie elsewhere, until all is installed
