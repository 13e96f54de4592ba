"""Many random states and strain increments at once, for the tests of the compiled law."""

import numpy as np

from labkit.model.state import isotropic_state
from labkit.plugins.umat.material_point import update


def deviators(rng, sizes):
    """Random deviatoric tensors in Mandel notation (n, 6) with norms `sizes` (n,)."""
    tensors = rng.normal(size=(len(sizes), 6))
    tensors[:, :3] -= tensors[:, :3].mean(axis=1, keepdims=True)
    return tensors * (sizes / np.linalg.norm(tensors, axis=1))[:, None]


def random_states(rng, n):
    """State vectors (n, 21) with tensors that are not coaxial."""
    scalars = rng.uniform((0.58, 4.2, 1e-3), (0.74, 6.0, 1.5e-2), size=(n, 3))
    return np.hstack([scalars, *(deviators(rng, rng.uniform(0, most, n)) for most in (0.5, 0.9, 0.06))])


def random_increments(rng, n, sizes):
    """Strain increments (n, 6) with norms `sizes`, (n,) or one number."""
    increments = rng.normal(size=(n, 6))
    return increments * (np.broadcast_to(sizes, n) / np.linalg.norm(increments, axis=1))[:, None]


def random_walks(model, walks=8, turns=20, between=20):
    """States (walks, 21) at 500 kPa and increments (n, walks, 6) that turn to a random direction after every `between`.

    All six components change; the strain of each straight part is 2e-5 to 6e-3, and a compression of a fiftieth of it
    keeps p from vanishing.
    """
    rng = np.random.default_rng(8)
    start = np.array([isotropic_state(model, e, 0.5e6).vector()[:21] for e in np.linspace(0.6, 0.7, walks)])
    parts = [deviators(rng, 10.0 ** rng.uniform(-6, -3.5, walks)) for _ in range(turns)]
    for part in parts:
        part[:, :3] += 0.02 * np.linalg.norm(part, axis=1, keepdims=True)
    return start, np.repeat(parts, between, axis=0)


def largest_difference(model, start, increments, one):
    """The largest difference of state, stress and tangent from Python along paths, relative to each point's largest.

    `one(state, increment)` returns them for one point, in labkit's order and signs. Every increment must succeed.
    """
    state, own, worst = start, [(y, None, None) for y in start], 0.0
    for step in increments:
        found = update(model, state, step).require()
        state = found.state
        own = [one(point[0], increment) for point, increment in zip(own, step, strict=True)]
        for k, point in enumerate(own):
            for got, expected in zip(point, (found.state[k], found.stress[k], found.tangent[k]), strict=True):
                worst = max(worst, float(np.abs(got - expected).max() / np.abs(expected).max()))
    return worst
