"""The recorder node: one platform's recorders, and the collector of all parts."""
