"""Several bags into one, or a part of one, without decoding a message; the manifest of it, and whether it is whole."""
