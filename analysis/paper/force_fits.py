"""How F_zz depends on the fitting method, and the normalised force against the formula printed in section 3.

The contacts come from the ends of two tests, one specimen each: differences between fits of the same contacts are
exact, but they do not show whether other specimens have the same differences.
"""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np
import pandas
from matplotlib.figure import Figure

import labkit as lk
from analysis.paper.drawing import WIDTH
from analysis.paper.ends import Runs
from labkit.micro import DirectionalFit, contact_anisotropy, contact_arms, directional_fit, normalisation

BINS = 10  # bins of |cos(theta)|, equal solid angles
PAPER = "paper"
METHODS = {
    PAPER: "Eqs. 24 and 25: weights 1/(1 + n.A n)",
    "bins": f"least squares over {BINS} bins of equal solid angle",
    "contacts": "least squares over contacts",
    "fourth": "Eqs. 24 and 25 with weights and force of fourth order",
    "no_overlap": "Eqs. 24 and 25 without lambda'",
    "raw": "Eqs. 24 and 25 with the force instead of the normalised force",
    "raw_bins": f"least squares over {BINS} bins with the force",
}


def force_fits(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per run, at its last snapshot, and method of METHODS.

    F_zz; change: from the paper's method on the same contacts; Lambda (with the force instead of Lambda_n: N).
    """
    rows = []
    for name, strain, snapshot in _ends(runs):
        fits = _fits(snapshot)
        for method, label in METHODS.items():
            F, papers = (float(fits[key].second[2, 2]) for key in (method, PAPER))
            rows.append((name, strain, method, label, F, F - papers, fits[method].mean))
    return pandas.DataFrame(rows, columns=["run", "strain", "method", "description", "F_zz", "change", "Lambda"])


def printed_force(runs: Runs) -> pandas.DataFrame:
    """f~ of section 3 as printed, (3 lambda'/2) E delta/D*, over f~ = 3 lambda' f/(pi D^2), a row per run.

    `printed_over_defined` is the ratio of the means over all contact sides, with f = (pi/2) E D* delta and no dashpot.
    `corrected` is the same for the printed formula times (D*/D)^2, the missing factor, which is 1/4 for equal grains.
    """
    rows = []
    for name, strain, snapshot in _ends(runs):
        D = 2.0 * snapshot.radius[snapshot.contacts.grain]
        effective = (D[:, 0] * D[:, 1] / D.sum(axis=1))[:, None]
        overlap, E = snapshot.contacts.overlap[:, None], snapshot.young_modulus
        defined = normalisation(snapshot) * (0.5 * np.pi * E * effective * overlap)
        arm = contact_arms(snapshot) / (0.5 * D)  # lambda'
        printed = 1.5 * arm * E * overlap / effective
        corrected = printed * (effective / D) ** 2
        rows.append((name, strain, *(float(force.mean() / defined.mean()) for force in (printed, corrected))))
    return pandas.DataFrame(rows, columns=["run", "strain", "printed_over_defined", "corrected_over_defined"])


def draw_force_fits(runs: Runs) -> Figure:
    """Mean normalised force against the direction of the contacts at the last snapshot of each test, with the fits."""
    figure, panels = plt.subplots(1, len(runs), figsize=(WIDTH, 4.4), layout="constrained", squeeze=False, sharey=True)
    for axes, (name, strain, snapshot) in zip(panels[0], _ends(runs), strict=True):
        n, values = snapshot.contacts.normal, _normal(snapshot)
        fits, scale = _fits(snapshot), 1e3
        axis = np.linspace(0.0, 1.0, 101)
        directions = np.column_stack([np.sqrt(1.0 - axis**2), 0.0 * axis, axis])
        middle, mean = _bins(n, values)
        axes.plot(middle, scale * mean, "ko", ms=4, label="contacts, bins of equal solid angle")
        for method, style in ((PAPER, "-"), ("bins", "--"), ("contacts", "-."), ("fourth", ":")):
            F = fits[method].second[2, 2]
            axes.plot(
                axis, scale * fits[method].at(directions), style, label=f"{METHODS[method]}: $F_{{zz}}$ = {F:.3f}"
            )
        axes.set(xlabel=r"$|\cos\theta|$ of the contact normal with z", title=f"{name}, {100 * strain:.0f} % strain")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize=6.5)
    panels[0][0].set_ylabel(r"mean normalised normal force $\overline{\Lambda^n}$ ($10^{-3}$)")
    return figure


def _ends(runs: Runs) -> Iterator[tuple[str, float, lk.Snapshot]]:
    """(run, axial strain, snapshot) at the last snapshot of each run."""
    for name, run in runs.items():
        yield name, float(run["axial_strain"][int(run["record"][-1])]), run.lab.snapshot(-1)


def _normal(snapshot: lk.Snapshot, overlap: bool = True) -> np.ndarray:
    """Lambda_n of each contact (n,), mean of both sides; `overlap`: with lambda'."""
    factor = normalisation(snapshot)
    if not overlap:
        factor = factor * snapshot.radius[snapshot.contacts.grain] / contact_arms(snapshot)
    return factor.mean(axis=1) * snapshot.contacts.normal_force / snapshot.young_modulus


def _fits(snapshot: lk.Snapshot) -> dict[str, DirectionalFit]:
    n, force = snapshot.contacts.normal, snapshot.contacts.normal_force
    values = _normal(snapshot)
    A = contact_anisotropy(n)
    density = directional_fit(n, np.ones(len(n)), order=4)
    weight, fourth = 1.0 / (1.0 + np.einsum("ni,ij,nj->n", n, A, n)), 1.0 / density.shape(n)
    return {
        PAPER: directional_fit(n, values * weight),
        "bins": _least_squares(*_bins(n, values)),
        "contacts": _least_squares(np.abs(n[:, 2]), values),
        "fourth": directional_fit(n, values * fourth, order=4),
        "no_overlap": directional_fit(n, _normal(snapshot, overlap=False) * weight),
        "raw": directional_fit(n, force * weight),
        "raw_bins": _least_squares(*_bins(n, force)),
    }


def _bins(n: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(mean |cos(theta)|, mean of the values) in bins of equal solid angle, both (bins,)."""
    cosine = np.abs(n[:, 2])
    bin_of = np.minimum((cosine * BINS).astype(int), BINS - 1)
    count = np.bincount(bin_of, minlength=BINS)
    return np.bincount(bin_of, cosine, BINS) / count, np.bincount(bin_of, values, BINS) / count


def _least_squares(cosine: np.ndarray, values: np.ndarray) -> DirectionalFit:
    """Axisymmetric fit Lambda [1 + F_zz (3 cos^2 - 1)/2] by least squares."""
    shape = np.column_stack([np.ones_like(cosine), 1.5 * cosine**2 - 0.5])
    mean, part = np.linalg.lstsq(shape, values, rcond=None)[0]
    return DirectionalFit(float(mean), part / mean * np.diag([-0.5, -0.5, 1.0]), np.zeros((3, 3, 3, 3)))
