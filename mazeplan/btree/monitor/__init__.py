"""Watch the tree of a run live in Groot2, by its monitoring protocol over ZeroMQ. Optional: the extra `groot`."""
