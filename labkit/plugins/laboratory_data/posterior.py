"""Distribution of the parameters of the grains, given measured tests: Gaussian processes of the curves, and emcee.

The points of the curves are reduced to principal components, each of which is interpolated between the samples by a
Gaussian process (scikit-learn) that also fits the scatter between specimens. The measured points y have the likelihood

    y ~ N(m(x), s^2 C + S(x)),    log s uniform between 0 and log 10

where m and S are the mean and covariance of the Gaussian processes and C is the covariance of the laboratory's scatter.
The factor s measures the misfit that no parameters remove. The affine-invariant sampler emcee draws from the posterior;
the prior is uniform.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path as File

import numpy as np
import pandas
from scipy.stats import qmc

from labkit.engines.base import Progress
from labkit.errors import InputError
from labkit.parameters import Parameter
from labkit.plugins.laboratory_data.sampling import GrainTests, Sample, append_sample, read_samples, take_sample
from labkit.process.blas import one_blas_thread
from labkit.process.extras import require_library
from labkit.process.interruption import only_writer, resumed_from, stop_on_signals
from labkit.simulation.api import progress_function

FIRST = 0.5  # fraction of the samples that fill the prior; later samples follow the posterior
BATCH = 8  # number of samples between two updates of the posterior
VARIANCE = 0.995  # fraction of the curves' variance that the principal components retain
LARGEST_MISFIT = 10.0  # largest s
WALKERS, LENGTH, BURNT = 40, 600, 200
LEAST_SUCCESSES = 8


@dataclasses.dataclass(frozen=True, eq=False)
class Posterior:
    """Draws from the posterior, and the samples behind them.

    Args:
        draws: Parameters, one column each, and `misfit`: s, the unexplained deviation in units of the scatter.
        samples: Simulated samples.
    """

    draws: pandas.DataFrame
    samples: Sequence[Sample]

    def table(self) -> pandas.DataFrame:
        """Return the mean and the 5, 50 and 95 % quantiles of each parameter."""
        quantiles = self.draws.quantile([0.05, 0.5, 0.95]).T
        quantiles.columns = ["5 %", "50 %", "95 %"]
        quantiles.insert(0, "mean", self.draws.mean())
        return quantiles

    def some(self, number: int, seed: int = 1) -> list[dict[str, float]]:
        """Return a few draws of the parameters, with which to simulate other tests."""
        chosen = self.draws.drop(columns="misfit").sample(number, random_state=seed)
        return [{str(name): float(value) for name, value in row.items()} for row in chosen.to_dict("records")]


def calibrate_grains(
    tests: GrainTests,
    samples: int = 48,
    *,
    file: str | os.PathLike[str] | None = None,
    progress: bool | Progress = True,
    grains: int = 300,
    largest: int = 1000,
    seed: int = 1,
) -> Posterior:
    """Find the parameters with which grains reproduce measured tests.

    The first half of the samples fills the ranges of the parameters; the others follow the posterior, on specimens that
    grow from `grains` to `largest` as it narrows. Failures show which parameters are impossible.

    Raises InputError, also if another process is writing `file`, and Interrupted after Ctrl-C or SIGTERM.

    Args:
        tests: The measured tests, the free parameters and the scatter.
        samples: Number of parameter sets, at least 8; each repeats all tests.
        file: File of samples, to which each is added once computed; the same call continues an interrupted calibration.
        grains: Number of grains of the first specimens.
        largest: Largest number of grains.
        seed: Seed of the parameters and the specimens.
        progress: True to show the progress, or a function of the completed fraction and a text.
    """
    _require_libraries()
    samples = Parameter("samples", kind=int, low=LEAST_SUCCESSES, high=100_000).read(samples)
    show = progress_function(progress, "calibration")
    with contextlib.ExitStack() as context:
        if file is not None:
            context.enter_context(only_writer(File(file)))
            context.enter_context(resumed_from(file))
        return posterior_of(tests, _take_samples(tests, samples, file, grains, largest, seed, show), seed)


def _take_samples(
    tests: GrainTests,
    samples: int,
    file: str | os.PathLike[str] | None,
    grains: int,
    largest: int,
    seed: int,
    show: Progress,
) -> list[Sample]:
    """Return the samples in the file and those still missing, which are added to the file; see calibrate_grains."""
    taken = [] if file is None else read_samples(tests, file)
    low, high = np.array([*tests.free.values()]).T
    filling = low + (high - low) * qmc.Sobol(len(low), seed=seed).random(1 << (samples - 1).bit_length())
    ahead: list[dict[str, float]] = []
    size = grains
    while len(taken) < samples:
        number = len(taken)
        show(number / samples, f"sample {number + 1} of {samples}, {size} grains")
        if number < FIRST * samples or sum(sample.points is not None for sample in taken) < LEAST_SUCCESSES:
            parameters = dict(zip(tests.free, map(float, filling[number]), strict=True))
        else:
            if not ahead:
                now = posterior_of(tests, taken, seed)
                ahead = now.some(BATCH, seed + number)
                width = now.draws[[*tests.free]].std().to_numpy() / ((high - low) / np.sqrt(12.0))
                size = int(np.clip(grains / np.exp(np.log(width).mean()), grains, largest))
            parameters = ahead.pop()
        sample = take_sample(tests, parameters, size, seed + number)
        taken.append(sample)
        if file is not None:
            append_sample(sample, file)
    return taken


@one_blas_thread()  # on two threads, matrices this small cost fifteen times the processor time
def posterior_of(tests: GrainTests, samples: Iterable[Sample], seed: int = 1) -> Posterior:
    """Return the posterior given samples, without simulating. Raises InputError if too few of them succeeded."""
    _require_libraries()
    import emcee

    samples = list(samples)
    successes = [sample for sample in samples if sample.points is not None]
    if len(successes) < LEAST_SUCCESSES:
        reasons = "; ".join(
            dict.fromkeys(sample.failure for sample in samples if sample.failure) or ["give more samples"]
        )
        raise InputError(f"only {len(successes)} of {len(samples)} samples succeeded: choose other ranges ({reasons})")
    logarithm = _Likelihood(tests, samples)
    size, random = len(tests.free) + 1, np.random.default_rng(seed)
    start = random.uniform(size=(WALKERS, size))
    start = start[np.argsort(logarithm(start))[-WALKERS // 2 :]].repeat(2, axis=0) * 0.98 + 0.02 * start
    sampler = emcee.EnsembleSampler(WALKERS, size, logarithm, vectorize=True)
    sampler.random_state = np.random.RandomState(seed).get_state()
    with stop_on_signals():  # emcee prints a traceback for an exception
        sampler.run_mcmc(start, LENGTH)
    chain = sampler.get_chain(discard=BURNT, flat=True, thin=4)
    low, high = np.array([*tests.free.values()]).T
    draws = pandas.DataFrame(low + (high - low) * chain[:, :-1], columns=[*tests.free])
    return Posterior(draws.assign(misfit=LARGEST_MISFIT ** chain[:, -1]), tuple(samples))


class _Likelihood:
    """Logarithm of the likelihood of the measured points in the unit cube; the last coordinate scales log s."""

    def __init__(self, tests: GrainTests, samples: Sequence[Sample]) -> None:
        """Fit a Gaussian process to each principal component of the points of the samples."""
        low, high = np.array([*tests.free.values()]).T
        where = (np.array([[sample.parameters[name] for name in tests.free] for sample in samples]) - low) / (
            high - low
        )
        succeeded = np.array([sample.points is not None for sample in samples])
        self.covariance = tests.deviations
        self.scale = np.sqrt(np.diag(self.covariance))
        points = np.array([sample.points for sample in samples if sample.points is not None]) / self.scale
        self.mean = points.mean(axis=0)
        left, strength, right = np.linalg.svd(points - self.mean, full_matrices=False)
        modes = int(np.searchsorted(np.cumsum(strength**2) / np.sum(strength**2), VARIANCE)) + 1
        self.axes, scores = right[:modes], left[:, :modes] * strength[:modes]
        grains = np.array([sample.grains for sample in samples])[succeeded]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # scikit-learn warns about parameters at the end of their range
            self.processes = [_process(where[succeeded], score, grains.min() / grains) for score in scores.T]
        self.measured = tests.points(tests.measured) / self.scale
        self.covariance = self.covariance / np.outer(self.scale, self.scale)
        self.feasible = _feasibility(where, succeeded)

    def __call__(self, unit: np.ndarray) -> np.ndarray:
        """Return the logarithm, (n,), at points of the unit cube, (n, parameters + 1)."""
        x, logarithm = unit[:, :-1], unit[:, -1]
        inside = ((unit >= 0.0) & (unit <= 1.0)).all(axis=1)
        x = np.clip(x, 0.0, 1.0)
        predictions = [process.predict(x, return_std=True) for process in self.processes]
        scores, variance = (np.array([pair[k] for pair in predictions]).T for k in (0, 1))
        difference = self.measured - self.mean - scores @ self.axes
        factor = LARGEST_MISFIT ** (2.0 * np.clip(logarithm, 0.0, 1.0))
        covariance = factor[:, None, None] * self.covariance
        covariance = covariance + np.einsum("nk,ki,kj->nij", variance**2, self.axes, self.axes)
        solved = np.linalg.solve(covariance, difference[:, :, None])[:, :, 0]
        value = -0.5 * np.einsum("ni,ni->n", difference, solved) - 0.5 * np.linalg.slogdet(covariance)[1]
        return np.where(inside, value + np.log(self.feasible(x) + 1e-12), -np.inf)


def _process(x: np.ndarray, score: np.ndarray, share: np.ndarray):
    """Return a Gaussian process with fitted noise, which is smaller for specimens with more grains."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    spread = float(score.std())
    smooth = ConstantKernel(1.0, (0.01, 100.0)) * RBF(np.ones(x.shape[1]), (0.5, 10.0))
    first = GaussianProcessRegressor(smooth + WhiteKernel(0.1, (1e-4, 1.0)), random_state=0)
    first.fit(x, score / spread)
    kernel = ConstantKernel(spread**2) * first.kernel_.k1
    noise = spread**2 * first.kernel_.k2.noise_level
    return GaussianProcessRegressor(kernel, alpha=noise * share, optimizer=None).fit(x, score)


def _feasibility(x: np.ndarray, succeeded: np.ndarray):
    """Return a function that estimates the probability of success of the tests at points (n, d) of the unit cube."""
    if succeeded.all():
        return lambda points: np.ones(len(points))
    from sklearn.gaussian_process import GaussianProcessClassifier
    from sklearn.gaussian_process.kernels import RBF

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # scikit-learn warns about parameters at the end of their range
        classifier = GaussianProcessClassifier(10.0 * RBF(0.5, (0.1, 10.0)), random_state=0).fit(x, succeeded)
    return lambda points: classifier.predict_proba(points)[:, 1]


def _require_libraries() -> None:
    for name in ("sklearn", "emcee"):
        require_library(name, "calibrations of grains", "laboratory")
