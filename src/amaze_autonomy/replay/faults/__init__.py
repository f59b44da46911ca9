"""Faults on recorded data: pure, seeded functions on the stream of messages, each counting what it touched."""

from __future__ import annotations

from .kinds import RECORDED_FAULT, RECORDED_KINDS, TOPIC

__all__ = ["RECORDED_FAULT", "RECORDED_KINDS", "TOPIC"]
