"""The serial line to the board that moves the plate (docs/protocol.md)."""
