"""The elastic stiffness of a state from its contacts, by linear algebra alone: an independent check of the probes."""

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve

from labkit.micro.snapshot import love_stress
from labkit.micro.tensors import symmetric, to_tensor


def elastic_stiffness(state):
    """(6, 6) in Mandel notation, Pa: the springs of all contacts, with the grains free to move and to rotate.

    The energy of the springs, of second order in the displacements, is minimised over the fluctuations of the grains.
    The normal forces add a term -(fn/l) |tangential displacement|^2, and the logarithmic strain one of -sigma : H^2.
    """
    at = state.snapshot()
    contacts, R, m = at.contacts, at.radius, len(at.contacts)
    a, b = contacts.grain.T
    n, length = contacts.normal, contacts.branch_length(R)
    scene = state.scene
    kn, kt, kr = (
        stiffness(R[a], R[b])
        for stiffness in (scene.normal_stiffness, scene.tangential_stiffness, scene.rolling_stiffness)
    )
    nn = n[:, :, None] * n[:, None, :]
    tangent = np.eye(3) - nn
    cross = np.cross(np.eye(3)[None, :, :], n[:, None, :]).transpose(0, 2, 1)  # cross @ theta = theta x n
    arms = (np.stack([R[a], R[b]]) - 0.5 * contacts.overlap)[:, :, None, None]
    moves = _rows(m, len(R), (a, 0, -np.eye(3)), (b, 0, np.eye(3)))
    slips = _rows(m, len(R), (a, 0, -tangent), (b, 0, tangent), (a, 3, -arms[0] * cross), (b, 3, -arms[1] * cross))
    bends = _rows(m, len(R), (a, 3, -tangent), (b, 3, tangent))
    B = sparse.vstack([moves, slips, bends]).tocsr()
    D = [kn[:, None, None] * nn - (contacts.normal_force / length)[:, None, None] * tangent]
    D += [kt[:, None, None] * tangent, kr[:, None, None] * tangent]
    D = sparse.block_diag([sparse.block_diag(list(part)) for part in D]).tocsr()
    basis = to_tensor(np.eye(6))
    affine = np.einsum("kij,cj->kci", basis, n) * length[:, None]
    A = np.zeros((9 * m, 6))
    A[: 3 * m] = affine.reshape(6, -1).T
    A[3 * m : 6 * m] = np.einsum("cij,kcj->kci", tangent, affine).reshape(6, -1).T
    K, F = (B.T @ D @ B).tocsc(), B.T @ (D @ A)
    K += 1e-12 * K.diagonal().max() * sparse.eye(K.shape[0])  # holds the rattlers
    stiffness = (A.T @ (D @ A) - F.T @ spsolve(K, F)) / at.volume
    of_strain = np.einsum("ij,ajk,bki->ab", symmetric(love_stress(at)), basis, basis)
    return stiffness - 0.5 * (of_strain + of_strain.T)


def _rows(m, grains, *blocks):
    """Sparse (3 m, 6 grains): for each contact the blocks (m, 3, 3) of the displacements (0) or rotations (3)."""
    rows = np.arange(3 * m).reshape(m, 3, 1)
    total = sparse.csr_matrix((3 * m, 6 * grains))
    for grain, offset, block in blocks:
        columns = (6 * grain + offset)[:, None, None] + np.arange(3)
        full = np.broadcast_to(block, (m, 3, 3))
        at = np.broadcast_to(rows, full.shape).ravel(), np.broadcast_to(columns, full.shape).ravel()
        total = total + sparse.csr_matrix((full.ravel(), at), shape=total.shape)
    return total
