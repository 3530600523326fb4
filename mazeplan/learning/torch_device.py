"""torch, which only networks need: whether it is installed, and the device on which it trains."""

from __future__ import annotations

from mazeplan.core.errors import InputError
from mazeplan.core.resources import to_install

DEVICES = ("cpu", "cuda")


def require_torch() -> None:
    """Raise InputError, with the command to install, if torch is missing or broken."""
    try:
        import torch  # noqa: F401  only to see whether it loads
    except ImportError as problem:
        raise InputError(f"networks need torch: {to_install('learn')} ({problem})") from None


def require_device(device: str) -> None:
    """Raise InputError for an unknown device, and for cuda if torch sees no such device."""
    import torch

    if device not in DEVICES:
        raise InputError(f"--device: got {device!r}, expected one of {', '.join(DEVICES)}")
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("--device: got cuda, but torch sees no such device; expected cpu")
