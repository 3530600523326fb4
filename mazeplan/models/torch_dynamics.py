"""Thousands of roll-outs by torch, on any device: the step of `physics.torch_ring`, and the process asked once a step.

The sum over the rows of the process is exact and not culled: a product of matrices, a power of two

    g = a^2 sum_j alpha_j 2^([z, 1, -|z|^2 / 2] [x_j, -|x_j|^2 / 2, 1]'),   x, z centred, in l sqrt(ln 2)

in pieces of at most ELEMENTS numbers, so that memory stays small whatever the batch. Every tensor is made on the device
asked for; what comes back is NumPy's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.models.fast_gp import UNIT
from mazeplan.models.gaussian_process import GaussianProcess
from mazeplan.physics.torch_ring import Ring, Servos, Tensor
from mazeplan.records import Array, IntArray

if TYPE_CHECKING:
    from mazeplan.models.batch import Plans, RingBatch

ELEMENTS = {"cpu": 2**18, "cuda": 2**27}  # of a piece of the kernel: what fits a cache; 1 GiB of a card's memory


class Process:
    """The mean of a trained process of family rbf with one plain term, for batches."""

    def __init__(self, gp: GaussianProcess, **where: Any) -> None:
        """where: device and dtype of all tensors. Raises ModelError for another kernel."""
        import torch

        term = gp.hyper.only
        self._columns = list(term.columns)
        scales = term.lengthscales * UNIT
        rows = gp.inputs[:, self._columns] / scales
        centre = rows.mean(axis=0)
        rows = rows - centre  # or the squares would lose digits
        wide = np.column_stack([rows, -0.5 * np.sum(rows**2, axis=1), np.ones(len(rows))])
        self._rows = torch.tensor(np.ascontiguousarray(wide.T), **where)
        self._alpha = torch.tensor(term.amplitude**2 * gp.alpha, **where)
        self._scales, self._centre = torch.tensor(scales, **where), torch.tensor(centre, **where)
        elements = ELEMENTS.get(torch.device(where["device"]).type, ELEMENTS["cpu"])
        self._piece = max(1, elements // len(gp))

    def mean(self, s: Tensor) -> Tensor:
        """(B,) at states (6, B)."""
        import torch

        angles = (torch.sin(s[0]), torch.cos(s[0]), torch.sin(s[2]), torch.cos(s[2]), torch.sin(s[4]), torch.cos(s[4]))
        seen = (s[1], s[3], s[5], *angles)
        z = torch.stack([seen[i] for i in self._columns], dim=1) / self._scales - self._centre
        wide = torch.cat([z, torch.ones_like(z[:, :1]), -0.5 * (z * z).sum(dim=1, keepdim=True)], dim=1)
        out = torch.empty_like(s[0])
        for a in range(0, len(out), self._piece):
            part = (wide[a : a + self._piece] @ self._rows).clamp_(-1000.0, 0.0).exp2_()
            out[a : a + self._piece] = part @ self._alpha
        return out


def roll_out(batch: RingBatch, starts: Array, plans: Plans, which: IntArray, pushes: Array) -> Array:
    """As `RingBatch.roll_out`, which has checked the shapes; the whole batch side by side."""
    import torch

    where: dict[str, Any] = {"device": batch.device, "dtype": getattr(torch, batch.precision)}
    with torch.inference_mode():
        return trajectories(batch, starts, plans, which, pushes, where).cpu().numpy().astype(np.float64)


def trajectories(
    batch: RingBatch, starts: Array, plans: Plans, which: IntArray, pushes: Array, where: dict[str, Any]
) -> Tensor:
    """The states (B, T+1, 6), still on the device."""
    import torch

    ring, servos = Ring(batch.parameters), Servos(batch.servos(), **where)
    process = None if batch.process is None else Process(batch.process, **where)
    dt, index = batch.parameters.dt, torch.tensor(which, device=where["device"])
    commands = torch.tensor(plans.commands, **where)
    gains, reference = (torch.tensor(part, **where) for part in plans.feedback())
    push = torch.tensor(pushes, **where)
    s = torch.tensor(np.ascontiguousarray(starts.T), **where)
    out = torch.empty((commands.shape[1] + 1, *s.shape), **where)
    out[0] = s
    for t in range(commands.shape[1]):
        u = commands[index, t].T
        if len(gains):
            u = u + torch.einsum("bij,bj->ib", gains[index, t], s.T - reference[index, t])
        s = ring.step(s, servos.pass_on(u), 0.0 if process is None else process.mean(s))
        if len(push):
            s[0] += 0.5 * dt * dt * push[:, t]
            s[1] += dt * push[:, t]
        out[t + 1] = s
    return out.permute(2, 0, 1)
