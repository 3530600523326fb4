"""Fit the network of a policy to the commands of the planner, with PyTorch on one core or a graphics card.

The loss compares commands clipped to the limits: where the planner tilts as far as possible, more tilt is not wrong. A
small share of the part beyond the limits stays in the loss, so that the network finds its way back. Errors count by
their size, not by their square: in front of an opening the planner chooses among different commands, and the mean of
two commands is neither of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mazeplan.core.errors import InputError
from mazeplan.core.progress import Advance, no_advance
from mazeplan.core.records import Array
from mazeplan.core.resources import to_install

if TYPE_CHECKING:
    import torch

DEVICES = ("cpu", "cuda")
BEYOND = 0.05  # share that counts of the part of a command beyond the limits
HUBER_WIDTH = 0.1  # of the limit; smaller errors count by their square
BATCH, RATE = 512, 3e-3
HELD_OUT = 0.1
MIN_SCALE = 1e-3  # smallest scale of an input


@dataclass(frozen=True)
class Fit:
    """A fitted network.

    layers:       weights and biases, float32
    mean, scale:  of the inputs
    error:        mean absolute error of a command on held-out samples, rad"""

    layers: tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]
    mean: NDArray[np.float32]
    scale: NDArray[np.float32]
    error: float


def _drawn(sizes: tuple[int, ...], generator: torch.Generator, device: str) -> list[torch.Tensor]:
    """First weights and biases of each layer. sizes: numbers of units, from the inputs to the outputs"""
    import torch

    parameters = []
    for i, o in pairwise(sizes):
        weights = torch.randn(o, i, generator=generator) / i**0.5
        parameters += [weights.to(device), torch.zeros(o, device=device)]
    return [p.requires_grad_(True) for p in parameters]


def fit_network(
    inputs: Array, commands: Array, turned: Array, limit: float, offset: Array, *,
    hidden: tuple[int, ...] = (64, 64), epochs: int = 30, seed: int = 0, device: str = "cpu",
    advance: Advance = no_advance,
) -> Fit:  # fmt: skip
    """Fit a network to commands. Raises InputError if the device is missing.

    inputs (N, M):    of the policy
    commands (N, 2):  rad
    turned (N, 2):    cosine and sine of the ball's angle
    limit:            largest command, rad
    offset (2,):      tilt of the table, rad
    hidden:           number of units of each hidden layer
    seed:             draws the same first weights and batches on either device
    device:           cpu or cuda"""
    import torch

    require_device(device)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    generator = torch.Generator().manual_seed(seed)
    mean, scale = inputs.mean(axis=0), np.maximum(inputs.std(axis=0), MIN_SCALE)
    mean, scale = mean.astype(np.float32), scale.astype(np.float32)
    x, u, cs, shift = (
        torch.tensor(np.asarray(a), dtype=torch.float32, device=device)
        for a in ((inputs - mean) / scale, commands / limit, turned, np.asarray(offset) / limit)
    )
    parameters = _drawn((inputs.shape[1], *hidden, 2), generator, device)

    def predicted(rows: torch.Tensor) -> torch.Tensor:
        h = x[rows]
        for k in range(0, len(parameters) - 2, 2):
            h = torch.tanh(torch.nn.functional.linear(h, parameters[k], parameters[k + 1]))
        h = torch.nn.functional.linear(h, parameters[-2], parameters[-1])
        c, s = cs[rows].T
        raw = torch.stack([c * h[:, 0] - s * h[:, 1], -(s * h[:, 0] + c * h[:, 1])], dim=1) - shift
        inside = raw.clamp(-1.0, 1.0)
        return inside + BEYOND * (raw - inside)

    rows = torch.randperm(len(x), generator=generator)
    held, train = rows[: int(HELD_OUT * len(x))], rows[int(HELD_OUT * len(x)) :]
    optimiser = torch.optim.Adam(parameters, lr=RATE)
    steps = max(len(train) // BATCH, 1)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, epochs * steps)
    for epoch in range(epochs):
        for batch in train[torch.randperm(len(train), generator=generator)].to(device).chunk(steps):
            optimiser.zero_grad()
            torch.nn.functional.smooth_l1_loss(predicted(batch), u[batch], beta=HUBER_WIDTH).backward()
            optimiser.step()
            schedule.step()
        advance(epoch + 1, epochs)
    with torch.no_grad():
        error = float((predicted(held).clamp(-1.0, 1.0) - u[held]).abs().mean()) * limit
    torch.set_num_threads(threads)
    arrays = [p.detach().cpu().numpy() for p in parameters]
    return Fit(tuple(zip(arrays[::2], arrays[1::2], strict=True)), mean, scale, error)


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
