"""Many random states and strain increments at once, for the tests of the compiled law."""

import numpy as np


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
