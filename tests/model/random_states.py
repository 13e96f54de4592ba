"""Random states, tensors and rotations for the tests of the model."""

import numpy as np

from labkit.model.state import ModelState

AXIS = np.diag([-0.5, -0.5, 1.0])


def deviator(rng, size):
    """A random symmetric deviatoric tensor of norm `size`."""
    tensor = rng.normal(size=(3, 3))
    tensor = tensor + tensor.T
    tensor -= np.trace(tensor) / 3 * np.eye(3)
    return size * tensor / np.linalg.norm(tensor)


def symmetric(rng, size):
    tensor = rng.normal(size=(3, 3))
    return size * (tensor + tensor.T) / np.linalg.norm(tensor + tensor.T)


def rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.diag(r))


def random_state(rng, e=None):
    """A state with tensors that are not coaxial."""
    return ModelState(
        rng.uniform(0.58, 0.74) if e is None else e,
        rng.uniform(4.2, 6.0),
        rng.uniform(1e-3, 1.5e-2),
        deviator(rng, rng.uniform(0, 0.5)),
        deviator(rng, rng.uniform(0, 0.9)),
        deviator(rng, rng.uniform(0, 0.06)),
    )


def assert_same_rates(found, expected, state, D):
    """Compare the rates of e, Z and Lambda within rounding, relative to terms that may cancel in their sums."""
    terms = np.linalg.norm(D) * np.array([1.0, state.Z, state.Lam]) + np.abs(expected[:3])
    np.testing.assert_allclose(found[:3] / terms, expected[:3] / terms, rtol=0, atol=1e-12)
