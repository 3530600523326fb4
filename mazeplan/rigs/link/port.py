"""Opens a serial port; errors give advice."""

from __future__ import annotations

import errno
from typing import TYPE_CHECKING

from mazeplan.core.errors import RigError
from mazeplan.core.resources import to_install

if TYPE_CHECKING:
    import serial

BAUD = 115200
POLL_S = 0.05  # s, longest wait of a read for the first byte
WRITE_S = 0.2  # s, longest wait of a write; a port that accepts no byte for so long is dead


def ports_found() -> list[str]:
    """Names of the serial ports behind USB. One of them may be the board."""
    from serial.tools.list_ports import comports

    return sorted(port.device for port in comports() if port.vid is not None)


def open_port(name: str) -> serial.Serial:
    """Open the port at 115200 baud, exclusively. Raises RigError with the port and advice."""
    try:
        import serial
    except ImportError as missing:
        raise RigError(f"{name}: a serial port needs pyserial: {to_install('hardware')}") from missing
    try:
        return serial.Serial(name, BAUD, timeout=POLL_S, write_timeout=WRITE_S, exclusive=True)
    except (serial.SerialException, OSError, ValueError) as problem:
        raise RigError(f"{name}: {_advice(name, problem)}") from problem
    except _terminal_errors() as problem:  # a port that vanishes while it is opened
        raise RigError(f"{name}: {_advice(name, OSError(*problem.args))}") from problem


def _terminal_errors() -> tuple[type[Exception], ...]:
    """termios.error, which is no OSError; empty on Windows, which has no termios."""
    try:
        import termios
    except ImportError:
        return ()
    return (termios.error,)


def _advice(name: str, problem: Exception) -> str:
    code = getattr(problem, "errno", None)
    if code in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        found = ", ".join(ports_found())
        return f"no such port; plug the board in, or name another port ({f'found: {found}' if found else 'none found'})"
    if code in (errno.EACCES, errno.EPERM):
        return (
            "may not be opened; add yourself to the group that owns it (often: sudo usermod -aG dialout $USER), log in"
        )
    if code in (errno.EAGAIN, errno.EBUSY) or "exclusively" in str(problem):
        return "another program uses it; close that one (a serial monitor?)"
    return f"cannot be opened as a serial port ({' '.join(str(problem).split())}); is that the board's port?"
