"""The operator's page: a board of what is shown, a server for it, the node."""
