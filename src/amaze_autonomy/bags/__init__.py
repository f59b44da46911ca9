"""ROS 1 bags as recordings: which topics, which messages at which times, and what of it is damaged."""

from .errors import BagError
from .recording import Entry, Recording, Topic

__all__ = ["BagError", "Entry", "Recording", "Topic"]
