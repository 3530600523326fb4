"""Finds and opens the serial port of a board; errors give advice."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mazeplan.core.errors import RigError
from mazeplan.core.resources import to_install

if TYPE_CHECKING:
    import serial

AUTO = "auto"  # as the name of a port: the only port behind USB
BAUD = 115200
POLL_S = 0.05  # s, longest wait of a read for the first byte
WRITE_S = 0.2  # s, longest wait of a write; a port that accepts no byte for so long is dead


def ports_found() -> list[str]:
    """Names of the serial ports behind USB. One of them may be the board. Raises RigError without pyserial."""
    try:
        from serial.tools.list_ports import comports
    except ImportError as missing:
        raise RigError(f"a serial port needs pyserial: {to_install('hardware')}") from missing
    return sorted(port.device for port in comports() if port.vid is not None)


def named_port(name: str) -> str:
    """The port of that name. For `auto`, raises RigError unless there is exactly one port behind USB."""
    if name != AUTO:
        return name
    found = ports_found()
    if len(found) != 1:
        got = f"found {', '.join(found)}; name the board's as `port:`" if found else "none found; plug the board in"
        raise RigError(f"port: auto: {got}")
    return found[0]


def open_port(name: str) -> serial.Serial:
    """Open the port at 115200 baud, exclusively. Raises RigError with the port and advice."""
    found = ", ".join(ports_found()) or "none"
    import serial

    try:
        return serial.Serial(name, BAUD, timeout=POLL_S, write_timeout=WRITE_S, exclusive=True)
    except Exception as problem:  # also termios.error, which is no OSError: a port that vanishes while it is opened
        what = f"cannot be opened ({' '.join(str(problem).split())})"
        raise RigError(
            f"{name}: {what}; is it the board's port (found: {found}), does no other program use it, and may you open"
            " it (often: sudo usermod -aG dialout $USER, then log in again)?"
        ) from problem
