"""Other authors' laws against independent implementations (the heads of curves/*.csv name them) and closed forms."""

from pathlib import Path

import numpy as np
import pytest
import scipy.integrate

import analysis.peers.laws  # noqa: F401  # registers them
from analysis.peers.invariants import ATMOSPHERE, cos_three_theta
from analysis.peers.norsand import critical_ratio, image_ratio
from labkit.micro.tensors import to_six, to_tensor
from labkit.model import MODELS
from labkit.model.law import law_rates
from labkit.model.tensors import deviatoric_part
from labkit.plugins.calibration.residuals import follow_strain

pytestmark = pytest.mark.slow

CURVES = Path(__file__).parent / "curves"
ROOT2 = np.sqrt(2.0)
CRITICAL_FABRIC = np.sqrt(2 / 3) * np.diag([-0.5, -0.5, 1.0])  # of norm 1
GIVEN = {
    "hypoplasticity": ("hypoplasticity", {}),
    "sanisand": ("sanisand", {"G0": 121.7397175, "lambda_c": 0.0190427764, "h0": 7.22718582}),
    "norsand_dense": ("norsand", {"n": 0.0}),
    "norsand_loose": ("norsand", {"n": 0.0}),
}


def along(law, start, steps, tolerance=1e-8):
    """States of a law along strain steps (n, 6)."""
    states = np.empty((len(steps) + 1, len(start)))
    assert follow_strain(start, steps, law.constants, law.floor(start), tolerance, states) == 0
    return states


@pytest.mark.parametrize("curve", GIVEN)
def test_a_law_follows_an_independent_implementation(curve):
    name, given = GIVEN[curve]
    rows = [line for line in (CURVES / f"{curve}.csv").read_text().splitlines() if line[0] not in "#e"]
    e11, e22, e33, e12, *stress, e = np.loadtxt(rows, delimiter=",").T
    law = MODELS[name](**given)
    zero = np.zeros_like(e11)
    strain = np.stack([e11, e22, e33, zero, zero, ROOT2 * e12], axis=1)
    first = np.diag([part[0] for part in stress[:3]])
    states = along(law, law.start(e[0], first), np.diff(strain, axis=0))
    found = states[:, [1, 2, 3, 6]] / np.array([1.0, 1.0, 1.0, ROOT2])
    expected = np.stack(stress, axis=1)
    error = np.linalg.norm(found - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert error.max() < 1e-3, error.max()
    np.testing.assert_allclose(states[:, 0], e, atol=1e-5)


def tensorial(law, F, e, p, D, strain):
    """The law of Li and Dafalias in 3 x 3 tensors along a strain rate D in any direction; states (e, stress, F).

    The normal is a finite difference of R/g, g in its form with sin 3 theta, and multiplier and rate of p solve

        dp = K (tr D - D_p L),    n:(ds - dp r) = K_p L,    ds = 2 G (dev D - L n)
    """
    c, one = law.values, np.eye(3)
    b = c["c"]

    def size(r):
        norm = np.linalg.norm(r)
        sine = -np.sqrt(6) * np.trace(r @ r @ r) / norm**3
        root = np.sqrt((1 + b**2) ** 2 + 4 * b * (1 - b**2) * sine)
        return np.sqrt(1.5) * norm * 2 * (1 - b) * sine / (root - (1 + b**2))

    def normal(r):
        h = 1e-5 * np.linalg.norm(r)
        units = np.eye(9).reshape(3, 3, 3, 3)
        units = 0.5 * (units + units.swapaxes(2, 3))
        slopes = [[(size(r + h * unit) - size(r - h * unit)) / (2 * h) for unit in row] for row in units]
        found = np.array(slopes) - np.trace(slopes) / 3 * one
        return found / np.linalg.norm(found)

    def rate(_, y):
        e, sigma, F = y[0], y[1:10].reshape(3, 3), y[10:].reshape(3, 3)
        p, d = np.trace(sigma) / 3, D - np.trace(D) / 3 * one
        r = sigma / p - one
        R = np.sqrt(1.5) * np.linalg.norm(r)
        n = normal(r) if R > 1e-6 else d / np.linalg.norm(d)
        g = np.sqrt(1.5) / size(n) if R < 1e-6 else R / size(r)
        G = c["G0"] * ATMOSPHERE * (2.97 - e) ** 2 / (1 + e) * np.sqrt(p / ATMOSPHERE)
        K = G * 2 * (1 + c["nu"]) / (3 - 6 * c["nu"])
        zeta = e - c["e0"] + c["lambda_c"] * (p / ATMOSPHERE) ** c["xi"] - c["e_A"] * (np.sum(F * n) - 1)
        modulus = 2 / 3 * G * (c["h1"] - c["h2"] * e) * (c["M_c"] * g * np.exp(-c["n"] * zeta) / max(R, 1e-6) - 1)
        dilatancy = np.sqrt(2 / 3) * c["d0"] * (np.exp(c["m"] * zeta) - R / (c["M_c"] * g))
        L, dp = np.linalg.solve(
            [[K * dilatancy, 1], [modulus + 2 * G, np.sum(n * r)]], [K * np.trace(D), 2 * G * np.sum(n * d)]
        )
        change = 2 * G * (d - L * n) + dp * one
        return np.concatenate([[-(1 + e) * np.trace(D)], change.ravel(), (c["k_F"] * L * (n - F)).ravel()])

    first = np.concatenate([[e], (p * one).ravel(), F.ravel()])
    at = np.linspace(0, strain, 41)
    return scipy.integrate.solve_ivp(rate, (0, strain), first, "LSODA", at, rtol=1e-8, atol=1e-8)


AXIAL = np.diag([-0.5, -0.5, 1.0])
OBLIQUE = np.array([[-0.5, 0.3, 0.2], [0.3, 0.2, -0.6], [0.2, -0.6, 0.36]])  # with some compression
SHEAR = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.0], [0.5, 0.0, 0.02]])


@pytest.mark.parametrize(
    ("D", "F", "e"),
    [(SHEAR, 0.6, 0.75), (OBLIQUE, 0.6, 0.75), (AXIAL, 0.0, 0.75), (AXIAL, 0.6, 0.75), (AXIAL, -0.6, 0.8)],
)
def test_acst_follows_its_tensorial_form(D, F, e):
    law, F, strain = MODELS["acst"](), F * CRITICAL_FABRIC, 0.2 if D is AXIAL else 0.1
    states = along(law, law.start(e, 2e5 * np.eye(3), fabric=F), np.tile(strain / 40 * to_six(D), (40, 1)))
    found = tensorial(law, F, e, 2e5, D, strain)
    assert found.success
    e, sigma, F = found.y[0], found.y[1:10].T.reshape(-1, 3, 3), found.y[10:].T.reshape(-1, 3, 3)
    error = np.linalg.norm(to_tensor(states[:, 1:7]) - sigma, axis=(1, 2)) / np.linalg.norm(sigma, axis=(1, 2))
    assert error.max() < 1e-3
    np.testing.assert_allclose(states[:, 0], e, atol=1e-5)
    np.testing.assert_allclose(to_tensor(states[:, 8:14]), F, atol=1e-3)


EXTENSION = {  # extension over compression at the critical state
    "hypoplasticity": lambda c: (3 - np.sin(np.radians(c["phi_c"]))) / (3 + np.sin(np.radians(c["phi_c"]))),
    "sanisand": lambda c: c["c"],
    "norsand": lambda c: 3 / (3 + c["M_tc"]),
    "acst": lambda c: c["c"],
}
COMPRESSION = {
    "hypoplasticity": lambda c: 6 * np.sin(np.radians(c["phi_c"])) / (3 - np.sin(np.radians(c["phi_c"]))),
    "sanisand": lambda c: c["M"],
    "norsand": lambda c: c["M_tc"],
    "acst": lambda c: c["M_c"],
}
LINE = {  # critical void ratio
    "hypoplasticity": lambda c, p: c["e_c0"] * np.exp(-((3 * p / c["h_s"]) ** c["n"])),
    "sanisand": lambda c, p: c["e0"] - c["lambda_c"] * (p / ATMOSPHERE) ** c["xi"],
    "norsand": lambda c, p: c["Gamma"] - c["lambda_c"] * np.log(p / 1e3),
    "acst": lambda c, p: c["e0"] - c["lambda_c"] * (p / ATMOSPHERE) ** c["xi"],
}


@pytest.mark.parametrize("name", EXTENSION)
def test_a_law_reaches_its_critical_state_in_compression_and_extension(name):
    law = MODELS[name]()
    e = LINE[name](law.values, 2e5) - 0.01
    for sign, ratio in ((1.0, 1.0), (-1.0, EXTENSION[name](law.values))):
        steps = np.tile(sign * 0.01 * np.array([-0.5, -0.5, 1.0, 0.0, 0.0, 0.0]), (150, 1))
        fabric = {"fabric": sign * CRITICAL_FABRIC} if name == "acst" else {}
        end = along(law, law.start(e, 2e5 * np.eye(3), **fabric), steps, 1e-6)[-1]
        p = end[1:4].mean()
        np.testing.assert_allclose((end[3] - end[1]) / p, sign * ratio * COMPRESSION[name](law.values), rtol=1e-3)
        np.testing.assert_allclose(LINE[name](law.values, p), e, atol=1e-3)


def yield_function(law, y):
    """q/p - M_i (1 + ln(p_i/p)) of NorSand, which is negative within its yield surface."""
    sigma, c = y[1:7], law.constants
    s, p = deviatoric_part(sigma), sigma[:3].mean()
    image_M, _, _ = image_ratio(y[0], y[7], critical_ratio(cos_three_theta(s), c)[0], c)
    return np.sqrt(1.5) * np.linalg.norm(s) / p - image_M * (1 + np.log(y[7] / p))


@pytest.mark.parametrize("D", [SHEAR, OBLIQUE], ids=["shear", "oblique"])
def test_norsand_stays_on_its_yield_surface_where_the_lode_angle_changes(D):
    law = MODELS["norsand"]()
    y, rate = law.start(0.7, 1e5 * np.diag([1.0, 1.5, 2.4])), np.empty(14)
    y[1:7] += 1e5 * to_six(0.1 * OBLIQUE)
    law.begin(y)
    assert law_rates(y, to_six(D), True, law.constants, rate) == 0
    h = 1e-7
    change = (yield_function(law, y + h * rate) - yield_function(law, y - h * rate)) / (2 * h)
    assert abs(yield_function(law, y)) < 1e-12
    assert abs(change) < 1e-5
