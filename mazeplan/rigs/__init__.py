"""Machines that carry a maze: the interface, the simulated rig and its faults, the conformance suite."""
