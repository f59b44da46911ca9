"""Bytes to messages and back: ports, frames, signatures, who speaks, and the one thread that owns a link."""
