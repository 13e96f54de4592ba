"""Eccentric contacts of grains that are not spheres, whose contact vectors are not parallel to the contact normals.

The contact vector on one side of a contact has a part along the outward normal and a part in the contact plane,

    l = l_n n + l_t,   l_n = l.n,

so the normal force f_n has a lever arm l_t about the centre of the grain. In Love's stress, l_t adds two terms to those
of spheres, with V_g = v the volume of the grain that owns the side:

    M = <f_n l_t (x) n/(v E)>/Lambda      X = <l_t (x) f_t/(v E)>/Lambda

To second order the mean of l_t in the direction n is l_t(n) = R <l_n/R> [G n - (n.G n) n], with R the radius of a
sphere of the same volume and G symmetric and traceless: the contact eccentricity. If l_t and f_n are not correlated in
a direction, G gives M (`normal_force_eccentricity`). G_zz is negative for grains that lie flat.
"""

from __future__ import annotations

import numpy as np

from labkit.micro.snapshot import OUTWARD, Snapshot, contact_arms


def tangential_arms(snapshot: Snapshot) -> np.ndarray:
    """Return l_t, the part of the contact vector in the contact plane, on each side, (n, 2, 3), in m; 0 for spheres."""
    contacts = snapshot.contacts
    if contacts.vectors is None:
        return np.zeros((len(contacts), 2, 3))
    along = contact_arms(snapshot)[:, :, None] * OUTWARD[:, None] * contacts.normal[:, None]
    return contacts.vectors - along


def eccentric_dyads(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """Return f_n l_t (x) n and l_t (x) f_t, divided by v E, on each side, (2, n, 2, 3, 3).

    `volume` is the volume v of each grain, (grain,), m3 (default: the volume of the sphere with its radius).
    """
    contacts = snapshot.contacts
    volume = 4.0 / 3.0 * np.pi * snapshot.radius**3 if volume is None else volume
    arm = tangential_arms(snapshot) * OUTWARD[:, None]  # the normal and both forces change sign from side to side
    arm = arm / (volume.take(contacts.grain) * snapshot.young_modulus)[:, :, None]
    forces = contacts.normal_force[:, None] * contacts.normal, contacts.tangential_force
    return np.stack([arm[..., None] * force[:, None, None, :] for force in forces])


def contact_eccentricity(snapshot: Snapshot, density: np.ndarray) -> np.ndarray:
    """Return the contact eccentricity G, (3, 3); NaN without contacts.

    G = 5 sym<n (x) t/(1 + n.A n)>, with t = (l_t/R)/<l_n/R> on each side and its outward normal n.

    Args:
        snapshot: The snapshot.
        density: 1 + n.A n for every contact, (n,).
    """
    contacts = snapshot.contacts
    if len(contacts) == 0:
        return np.full((3, 3), np.nan)
    radius = snapshot.radius.take(contacts.grain)
    t = (OUTWARD[:, None] * tangential_arms(snapshot) / radius[:, :, None]).mean(axis=1)
    t = t / (contact_arms(snapshot) / radius).mean() / density[:, None]
    nt = contacts.normal.T @ t / len(contacts)
    return 2.5 * (nt + nt.T)


def normal_force_eccentricity(G: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return M due to the contact eccentricity G alone, to second order, (3, 3), with n.B n = n.A n + n.F n.

    The mean of [G n - (n.G n) n] (x) n (1 + n.B n) over the sphere is G/5 + 2/15 G B - 8/105 sym(GB) - 2/105 tr(GB) I;
    if G and B are coaxial this is G/5 + 2/35 sym(GB) - 2/105 tr(GB) I (after Ouadfel and Rothenburg 2001).
    """
    product = G @ B
    return G / 5 + 2 / 15 * product - 4 / 105 * (product + product.T) - 2 / 105 * np.trace(product) * np.eye(3)
