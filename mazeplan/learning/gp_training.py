"""Hyperparameters of a Gaussian process by maximum posterior, with GPyTorch: exact, by Cholesky, seeded.

GPyTorch approximates above 800 rows (conjugate gradients, Lanczos); `exactly` switches that off. Inputs, features and
target are scaled. Priors on the log length scales keep undetermined length scales bounded. A few starts use `first`
rows, and the refinement of the best start uses `rows` rows, both evenly spread over the record. On a CPU the likelihood
and its derivatives come from `gp_likelihood`, which is five times as fast as automatic differentiation. Kernels,
constraints and priors are always those of GPyTorch.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.core.errors import InputError, SettingsError
from mazeplan.core.progress import Advance, Words, no_advance, no_words, piece
from mazeplan.core.records import Array
from mazeplan.core.resources import to_install
from mazeplan.learning.features import STATE_TERMS, KernelColumns
from mazeplan.learning.gaussian_process import FAMILIES, Hyperparameters, KernelTerm
from mazeplan.learning.gp_likelihood import log_likelihood
from mazeplan.learning.split import uniform_downsample

if TYPE_CHECKING:
    import torch

NOISE_FLOOR = 0.15  # minimum noise over the target's spread: impacts leave more, and a rough kernel would interpolate
LOOKS = 1.25  # maximum evaluations of the likelihood per iteration (of torch)
LOG_SCALE, LOG_WIDTH = 0.7, 1.5  # mean and deviation of the prior on log length scales, in deviations of the input


DEVICES = ("cpu", "cuda")


@dataclass(frozen=True)
class TrainingOptions:
    """Settings of the training. Raises SettingsError.

    first, rows:             number of rows for a start, and for the refinement
    starts:                  number of starts
    iterations, refinement:  number of iterations of a start, and of the refinement
    device:                  cpu or cuda
    seed:                    for the first values of the starts
    family:                  of the kernel; auto: the likelier family
    terms:                   columns and flip of each term of the kernel"""

    first: int = 600
    rows: int = 1000
    starts: int = 3
    iterations: int = 30
    refinement: int = 15
    device: str = "cpu"
    seed: int = 0
    family: str = "rbf"
    terms: KernelColumns = STATE_TERMS

    def __post_init__(self) -> None:
        for name in ("first", "rows", "starts", "iterations", "refinement"):
            if not (isinstance(getattr(self, name), int) and getattr(self, name) >= 1):
                raise SettingsError(f"got {getattr(self, name)!r}, expected a whole number >= 1", key=name)
        for name, allowed in (("device", DEVICES), ("family", (*FAMILIES, "auto"))):
            if getattr(self, name) not in allowed:
                raise SettingsError(f"got {getattr(self, name)!r}, expected one of {', '.join(allowed)}", key=name)

    @property
    def families(self) -> tuple[str, ...]:
        """The kernel families to try."""
        return FAMILIES if self.family == "auto" else (self.family,)


@dataclass(frozen=True)
class Training:
    """Result of the training.

    starts:   log posterior per row (of the scaled values) after each start
    refined:  the same after the refinement
    rows:     number of rows of the refinement"""

    hyper: Hyperparameters
    starts: tuple[float, ...]
    refined: float
    rows: int


def require_torch() -> None:
    """Raise InputError, with the command to install, if torch or gpytorch is missing or broken."""
    try:
        with warnings.catch_warnings():  # from a dependency of gpytorch
            warnings.filterwarnings("ignore", "`torch.jit.script` is deprecated", DeprecationWarning)
            import gpytorch  # noqa: F401  only to see whether it loads
            import torch  # noqa: F401  the same
    except ImportError as problem:
        advice = f"Gaussian-process models need torch and gpytorch: {to_install('learn')}"
        raise InputError(f"{advice} ({problem})") from None


@contextmanager
def exactly() -> Iterator[None]:
    """A context in which GPyTorch computes exactly, by Cholesky."""
    from gpytorch import settings

    with ExitStack() as stack:
        stack.enter_context(settings.fast_computations(False, False, False))
        stack.enter_context(settings.max_cholesky_size(10**9))
        yield


def require_device(device: str) -> None:
    """Raise InputError for an unknown device, and for cuda if torch sees no such device."""
    import torch

    if device not in DEVICES:
        raise InputError(f"--device: got {device!r}, expected one of {', '.join(DEVICES)}")
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("--device: got cuda, but torch sees no such device; expected cpu")


def train(
    inputs: Array,
    features: Array,
    y: Array,
    options: TrainingOptions | None = None,
    *,
    progress: Words = no_words,
    advance: Advance = no_advance,
) -> Training:
    """Hyperparameters for inputs (N, D), features (N, M) and values y (N,); M may be 0.

    progress:  receives each step in words
    advance:   receives the share done

    Raises InputError if torch or the device is missing, or if a sample is not finite."""
    require_torch()

    options = options or TrainingOptions()
    bad = ~np.isfinite(np.column_stack([inputs, features, y])).all(axis=1)
    if bad.any():
        raise InputError(f"sample {int(np.argmax(bad))}: got a value that is not a finite number")
    require_device(options.device)
    scale = _Scale.of(inputs, features, y, options)
    rng = np.random.default_rng(options.seed)
    few, many = (uniform_downsample(len(y), n) for n in (options.first, options.rows))
    found: list[tuple[float, Any]] = []
    each, last = (n * len(rows) ** 2 for n, rows in ((options.iterations, few), (options.refinement, many)))
    whole = each * options.starts * len(options.families) + last  # in proportion to the time
    with exactly():
        for family in options.families:
            for start in range(options.starts):
                progress(f"{family}, start {start + 1} of {options.starts}, {len(few)} rows")
                model = _model(scale.take(inputs, features, y, few), options, family)
                _scatter(model, rng, start)
                share = piece(advance, each * len(found), each, whole)
                found.append((_maximise(model, options.iterations, share), model))
        best = max(found, key=lambda pair: pair[0])[1]
        progress(f"{best.family}, refinement on {len(many)} rows")
        model = _model(scale.take(inputs, features, y, many), options, best.family)
        model.load_state_dict(best.state_dict())
        refined = _maximise(model, options.refinement, piece(advance, whole - last, last, whole))
    if not math.isfinite(refined):
        raise InputError("the likelihood of these samples has no finite maximum: are they all alike?")
    return Training(scale.plain(_hyperparameters(model)), tuple(value for value, _ in found), refined, len(many))


@dataclass(frozen=True)
class _Scale:
    """Offset and units of the inputs, units of features and target, for the optimiser."""

    middle: Array
    spread: Array
    features: Array
    y: float

    @classmethod
    def of(cls, inputs: Array, features: Array, y: Array, options: TrainingOptions) -> _Scale:
        def safe(values: Array) -> Array:
            return np.where(values > 1e-12, values, 1.0)

        spread, rms = safe(np.std(inputs, axis=0)), safe(np.sqrt(np.mean(features**2, axis=0)))
        middle = np.mean(inputs, axis=0)
        for columns, flip in options.terms:  # a flipped column is flipped about zero
            middle[[c for c, sign in zip(columns, flip, strict=False) if sign < 0.0]] = 0.0
        return cls(middle, spread, rms, float(safe(np.sqrt(np.mean(y**2)))))

    def take(self, inputs: Array, features: Array, y: Array, rows: Any) -> tuple[Array, Array, int]:
        """For some rows: scaled inputs and features side by side, scaled target, and the number of inputs."""
        scaled = np.hstack([(inputs[rows] - self.middle) / self.spread, features[rows] / self.features])
        return scaled, y[rows] / self.y, inputs.shape[1]

    def plain(self, h: Hyperparameters) -> Hyperparameters:
        """The hyperparameters in the units of the data."""
        spreads = [self.spread[list(term.columns)] for term in h.terms]
        terms = tuple(
            replace(term, lengthscales=term.lengthscales * spread, amplitude=term.amplitude * self.y)
            for term, spread in zip(h.terms, spreads, strict=True)
        )
        return replace(h, terms=terms, noise=h.noise * self.y, weight_sigma=h.weight_sigma * self.y / self.features)


def _part(columns: tuple[int, ...], flip: tuple[float, ...], family: str) -> Any:
    """A scaled kernel with a length scale for each column; odd if there is a flip."""
    import torch
    from gpytorch import kernels, priors

    class Odd(kernels.ScaleKernel):
        """outputscale (c(x, x') - c(x, F x'))."""

        def forward(self, x1: Any, x2: Any, diag: bool = False, **parameters: Any) -> Any:  # pyright: ignore
            x1, x2 = x1[..., list(columns)], x2[..., list(columns)]
            turned = x2 * torch.tensor(flip, dtype=x2.dtype, device=x2.device)
            even, other = (self.base_kernel.forward(x1, x, diag=diag) for x in (x2, turned))
            return self.outputscale * (even - other)

    prior = priors.LogNormalPrior(LOG_SCALE, LOG_WIDTH)
    ard: dict[str, Any] = {"ard_num_dims": len(columns), "lengthscale_prior": prior}
    ard |= {} if flip else {"active_dims": columns}
    base = kernels.MaternKernel(nu=0.5, **ard) if family == "exponential" else kernels.RBFKernel(**ard)
    part: Any = Odd(base) if flip else kernels.ScaleKernel(base)
    part.columns, part.flip = columns, flip
    return part


def _model(data: tuple[Array, Array, int], options: TrainingOptions, family: str) -> Any:
    """GPyTorch's exact model: the terms of the kernel, plus a linear kernel on the features (behind the inputs)."""
    import gpytorch
    import torch
    from gpytorch import kernels

    columns, y = (torch.tensor(part, dtype=torch.float64, device=options.device) for part in data[:2])
    d, m = data[2], columns.shape[1] - data[2]

    class Exact(gpytorch.models.ExactGP):
        def __init__(self) -> None:
            noise = gpytorch.constraints.GreaterThan(NOISE_FLOOR**2)
            super().__init__(columns, y, gpytorch.likelihoods.GaussianLikelihood(noise_constraint=noise))
            self.family, self.inputs = family, d
            self.parts = torch.nn.ModuleList([_part(columns, flip, family) for columns, flip in options.terms])
            self.linear = None
            if m:
                self.linear = kernels.LinearKernel(ard_num_dims=m, active_dims=tuple(range(d, d + m)))

        def forward(self, x: torch.Tensor) -> Any:
            covariance: Any = self.parts[0](x)
            for part in self.parts[1:]:
                covariance = covariance + part(x)
            if self.linear is not None:
                covariance = covariance + self.linear(x)
            zero = torch.zeros(x.shape[0], dtype=x.dtype, device=x.device)
            return gpytorch.distributions.MultivariateNormal(zero, covariance)

    return Exact().to(device=options.device, dtype=torch.float64)


def _scatter(model: Any, rng: np.random.Generator, start: int) -> None:
    """Set the first values of a start: typical values for start 0, else a draw around them."""
    import torch

    random = float(start > 0)  # the first start has typical values
    for part in model.parts:
        n = part.base_kernel.lengthscale.shape[-1]
        drawn = np.exp(0.7 + 0.8 * random * rng.standard_normal(n))
        part.base_kernel.lengthscale = torch.tensor(drawn, device=model.train_targets.device)
        part.outputscale = float(0.3 * np.exp(0.7 * random * rng.standard_normal()))
    model.likelihood.noise = float(0.1 * np.exp(0.7 * random * rng.standard_normal()))
    if model.linear is not None:
        model.linear.variance = torch.full_like(model.linear.variance, 0.3)


def _maximise(model: Any, iterations: int, advance: Advance = no_advance) -> float:
    """Maximise by L-BFGS. Returns the log posterior per row that it reached."""
    import torch

    model.train()
    posterior = _compiled_posterior if model.train_targets.device.type == "cpu" else _torch_posterior
    optimiser = torch.optim.LBFGS(model.parameters(), max_iter=iterations, line_search_fn="strong_wolfe")
    reached, looks = -math.inf, 0

    def closure() -> Any:
        nonlocal reached, looks
        optimiser.zero_grad()
        loss = -posterior(model)
        loss.backward()
        reached, looks = max(reached, -float(loss.detach())), looks + 1
        advance(looks, LOOKS * iterations)
        return loss

    optimiser.step(closure)
    advance(1, 1)
    return reached


def _torch_posterior(model: Any) -> Any:
    """Log posterior per row by GPyTorch, for a GPU."""
    import gpytorch

    objective: Any = gpytorch.mlls.ExactMarginalLogLikelihood(model.likelihood, model)
    return objective(model(*model.train_inputs), model.train_targets)


def _compiled_posterior(model: Any) -> Any:
    """Log posterior per row by `gp_likelihood`, for a CPU."""
    import torch

    columns, y = model.train_inputs[0].numpy(), model.train_targets.numpy()
    value, slopes = log_likelihood(_hyperparameters(model), columns[:, : model.inputs], columns[:, model.inputs :], y)
    parameters = [part.base_kernel.lengthscale for part in model.parts]
    parameters += [part.outputscale for part in model.parts] + [model.likelihood.noise]
    gradients = [*slopes.lengthscales, *slopes.variances, slopes.noise]
    if model.linear is not None:
        parameters.append(model.linear.variance)
        gradients.append(slopes.weights)
    total = torch.tensor(value, dtype=torch.float64)
    for parameter, gradient in zip(parameters, gradients, strict=True):  # a sum of value zero with this derivative
        by = torch.as_tensor(gradient, dtype=torch.float64).reshape(parameter.shape)
        total = total + torch.sum((parameter - parameter.detach()) * by)
    for _, module, prior, closure, _ in model.named_priors():
        total = total + prior.log_prob(closure(module)).sum()
    return total / len(y)


def _hyperparameters(model: Any) -> Hyperparameters:
    """Hyperparameters of the model, in its scaled units."""

    def plain(tensor: torch.Tensor) -> Array:
        return tensor.detach().cpu().numpy().astype(float).ravel()

    def root(tensor: torch.Tensor) -> float:
        return float(np.sqrt(plain(tensor)[0]))

    terms = tuple(
        KernelTerm(part.columns, plain(part.base_kernel.lengthscale), root(part.outputscale), part.flip)
        for part in model.parts
    )
    weights = np.zeros(0) if model.linear is None else np.sqrt(plain(model.linear.variance))
    return Hyperparameters(terms, root(model.likelihood.noise), weights, model.family)
