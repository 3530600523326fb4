"""The emulated rig: firmware on a simulated chip, rendered pictures and a simulated plate, in real time."""
