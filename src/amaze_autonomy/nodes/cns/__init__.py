"""The node that lets nodes of the CNS Flight Stack be peers of our engine."""
