"""Terms of Love's stress that the equation by volume neglects. With them the equation is exact.

The equation by volume is C0 with l f over the mean grain volume in Lambda (labkit.sff_stress_by_volume). In terms of
the weighted forces g = Lambda_n/(1 + n.A n) and h = -Lambda_t/(1 + n.A n) of the contacts, Love's stress divided by
E Z/(1+e) is <g (1 + n.A n) n n> + <(1 + n.A n) n (x) h>, and for clumps + Lambda (M - X). The equation contains the
moments of g to second order and the mean of n (x) h. It neglects

| term | |
|---|---|
| `normal_4` | 8/315 Lambda A:F4, where F4 = 315/8 times the traceless part of <g nnnn>/Lambda |
| `tangential_2` | <(n.A n) n (x) h> if h has second order in n (labkit.sff.tangential_coupling) |
| `tangential_4` | the remainder of <(n.A n) n (x) h> |

None of them has a trace, so the mean stress is exact. All divide only by 1 + n.A n, not by a density of fourth order.
"""

from __future__ import annotations

import numpy as np

from labkit.micro.contact_sides import mean_volume, vectors_of_contacts
from labkit.micro.fabric import directional_fit, normal_density
from labkit.micro.snapshot import Snapshot
from labkit.sff.family import scale_of, tangential_coupling

NEGLECTED = {
    "normal_4": "normal forces, order 4",
    "tangential_2": "tangential forces, order 2",
    "tangential_4": "tangential forces, order 4",
}


def neglected_terms(snapshot: Snapshot) -> dict[str, np.ndarray]:
    """Return what the equation by volume neglects, name in NEGLECTED -> (3, 3) Pa; zero without contacts or forces.

    Each term is a stress by itself, not a step of a chain: labkit.sff_stress_by_volume(snapshot) plus their sum is
    Love's stress.
    """
    if len(snapshot.contacts) == 0 or not snapshot.contacts.normal_force.any():
        return {name: np.zeros((3, 3)) for name in NEGLECTED}
    vectors = vectors_of_contacts(snapshot, mean_volume(snapshot))
    n, density = vectors.normal, normal_density(vectors.normal)
    shape, A = density.shape(n), density.second
    weighted = directional_fit(n, vectors.normal_component / shape, 4)
    dyads = -n.T @ (vectors.tangential / shape[:, None]) / len(n)
    coupled = -n.T @ (vectors.tangential * (1.0 - 1.0 / shape)[:, None]) / len(n)
    second = tangential_coupling(A, dyads)
    normal = 8 / 315 * weighted.mean * np.einsum("ijkl,kl->ij", weighted.fourth, A)
    terms = normal, second, coupled - second
    return {name: scale_of(snapshot) * term for name, term in zip(NEGLECTED, terms, strict=True)}
