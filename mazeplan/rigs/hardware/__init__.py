"""The real rig on the table, and its emulation."""
