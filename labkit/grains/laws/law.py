"""A contact law: a sum of parts, and its interface to engines, statistics and the energy balance."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Set
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np

from labkit.errors import InputError
from labkit.extensions import is_labkits
from labkit.files.schema import LOSSES
from labkit.grains.laws.bond import ParallelBond, stiffness_of
from labkit.grains.laws.cohesion import Adhesion
from labkit.grains.laws.contact import Contact, Tangents, Values
from labkit.grains.laws.damping import Dashpots
from labkit.grains.laws.kinematics import FirstOrder, Kinematics
from labkit.grains.laws.normal import LinearSpring
from labkit.grains.laws.pair import Composition, compose_law
from labkit.grains.laws.parts import PARAMETERS, SPECIAL, Column, LawPart, LawParts
from labkit.grains.laws.rolling import Rolling, Twisting
from labkit.grains.laws.tangential import Coulomb
from labkit.grains.laws.vectors import ZERO, Vector
from labkit.grains.laws.yade import YadeLaw, compose_yade
from labkit.parameters import Parameter, named

if TYPE_CHECKING:
    from labkit.grains.scene import Scene
    from labkit.grains.state import State
    from labkit.micro.snapshot import Contacts, Snapshot


AT_LIMIT = 0.999  # share of its limit from which a force or moment counts as limited


class ContactLaw:
    """A contact law. Arrays of radii and overlaps may have any shape; units are SI.

    A law has a `name`, used in scenes, files and on the command line; `parts`, the sum of one part of each kind; and
    `kinematics`, which say how a contact moves in a time step. `avoids_ratcheting` is True if its slip contains YADE's
    factor (Ra + Rb)/|d| (labkit.records.ratcheting).
    """

    name: ClassVar[str]
    description: ClassVar[str] = ""
    parts: ClassVar[LawPart | LawParts] = LinearSpring()
    kinematics: ClassVar[Kinematics] = FirstOrder
    avoids_ratcheting: ClassVar[bool] = False
    normal: ClassVar[LinearSpring]
    tangential: ClassVar[Coulomb]
    rolling: ClassVar[Rolling]
    twisting: ClassVar[Rolling]
    damping: ClassVar[Dashpots]
    cohesion: ClassVar[Adhesion]
    bond: ClassVar[ParallelBond]
    parts_by_kind: ClassVar[LawParts]

    def __init_subclass__(cls) -> None:
        """Store the parts, in the order of their columns of history."""
        super().__init_subclass__()
        parts = cls.parts if isinstance(cls.parts, LawParts) else LawParts(cls.parts)
        _require_parts(cls, parts)
        cls.parts_by_kind = LawParts(*({**DEFAULTS, **parts}[kind] for kind in {**DEFAULTS, **parts} if kind in parts))
        for kind, part in DEFAULTS.items():
            setattr(cls, kind, parts.get(kind, part))

    @property
    def has(self) -> Set[str]:
        """Kinds of the parts that the law has."""
        return self.parts_by_kind.keys()

    @property
    def columns(self) -> dict[str, Column]:
        """The columns of history of a contact: name -> Column."""
        return self.parts_by_kind.columns

    @property
    def losses(self) -> tuple[str, ...]:
        """Names of the losses of the parts, except friction, rolling and damping loss, which are in every file."""
        names = (name for part in self.parts_by_kind.values() for name in part.losses)
        return tuple(dict.fromkeys(name for name in names if name in LOSSES))

    def acting(self, scene: Scene) -> tuple[str, ...]:
        """Kinds of the parts that act on contacts in a scene."""
        return tuple(kind for kind, part in self.parts_by_kind.items() if part.acts(scene))

    def composition(self, scene: Scene) -> Composition:
        """Return the functions of the parts that act in a scene."""
        return compose_law(self, self.acting(scene), scene.limits == "forces")

    def numbers(self, scene: Scene) -> Values:
        """Return the parameters of a scene that the functions of the composition take."""
        acting = self.acting(scene)
        values: dict[str, object] = {"shear": self.tangential.share(scene)}
        if "tangential" in acting:
            values["friction"] = scene.friction
        values |= {kind: self.parts_by_kind[kind].numbers(scene) for kind in acting if kind != "tangential"}
        return compose_law(self, acting, scene.limits == "forces").make_numbers(**values)

    def normal_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Return the coefficient of the normal part: kn (N/m) of a linear spring."""
        return on_arrays(self.normal.stiffness)(self.normal.factor(scene), *scene.elastic_radii(radius_a, radius_b))

    def tangential_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Return the coefficient of the tangential part: kt (N/m) of a linear spring."""
        return self.tangential.share(scene) * self.normal_stiffness(scene, radius_a, radius_b)

    def tangents(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray) -> Tangents:
        """Return tangent stiffnesses and dashpot coefficients at an overlap (m) for the time step and the servo.

        With JKR, the normal stiffness is an upper bound: 2 E* a of a Hertz contact with the contact radius a. A bond is
        treated as if it joined touching grains.
        """
        acting, coefficient = self.acting(scene), self.normal_stiffness(scene, radius_a, radius_b)
        wide = np.maximum(overlap, 0.0)
        if "cohesion" in acting:
            wide = on_arrays(self.cohesion.equivalent)(
                self.cohesion.numbers(scene), coefficient, radius_a, radius_b, overlap
            )
        kn = on_arrays(self.normal.tangent)(coefficient, wide)
        kt = on_arrays(self.tangential.stiffness)(self.tangential.share(scene), coefficient, wide)
        kr, kw = (
            kt * on_arrays(part.stiffness)(part.numbers(scene), 1.0, radius_a, radius_b)
            if part.kind in acting
            else 0.0 * kt
            for part in (self.rolling, self.twisting)
        )
        if "bond" in acting:
            bond = on_arrays(stiffness_of)(self.bond.numbers(scene), radius_a, radius_b, radius_a + radius_b)
            kn, kt, kr, kw = (stiffness + of_bond for stiffness, of_bond in zip((kn, kt, kr, kw), bond, strict=True))
        if "damping" not in acting:
            return Tangents(kn, kt, kr, kw, 0.0 * kn, 0.0 * kt)
        beta_n, beta_t, _ = self.damping.numbers(scene)
        a, b = scene.mass(radius_a), scene.mass(radius_b)
        reduced = a * b / (a + b)
        return Tangents(kn, kt, kr, kw, beta_n * np.sqrt(reduced * kn), beta_t * np.sqrt(reduced * kt))

    def rolling_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Return the coefficient of the rolling part: kr (N m) of a linear spring; zero without a rolling part."""
        kt = self.tangential_stiffness(scene, radius_a, radius_b)
        if "rolling" not in self.has:
            return np.zeros_like(kt)
        return kt * on_arrays(self.rolling.stiffness)(self.rolling.numbers(scene), 1.0, radius_a, radius_b)

    def reach(self, state: State) -> float:
        """Return the largest gap (m) across which the grains of a State interact; 0 without cohesion or bonds.

        A bond that was created across a gap stretches like one between touching grains with the same distance.
        """
        lengths = state.columns.get("bond_length", np.zeros(len(state.contact_grain)))
        gap = (lengths - state.radius.take(state.contact_grain).sum(axis=1)).max(initial=0.0)
        scene, largest = state.scene, state.radius.max() + 0.5 * gap
        stiffness = float(self.normal_stiffness(scene, largest, largest))
        return float(gap + max(part.reach(scene, stiffness, largest) for part in self.parts_by_kind.values()))

    @property
    def far(self) -> bool:
        """True if grains may interact across a gap."""
        return any(type(part).reach is not LawPart.reach for part in self.parts_by_kind.values())

    def history_at(self, overlap: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the columns of history of contacts: the known columns, and initial values for all other columns.

        Args:
            overlap: Overlaps, (n,), in m.
            columns: The known columns: name -> values.
        """
        missing = {name: column for name, column in self.columns.items() if name not in columns}
        if not missing:
            return dict(columns)
        zero = {name: column.zeros(len(overlap)) for name, column in missing.items()}
        begun = {name: v for part in self.parts_by_kind.values() for name, v in part.begin(overlap).items()}
        return zero | begun | dict(columns)

    def forces(
        self, scene: Scene, radii: np.ndarray, overlap: np.ndarray, columns: Mapping[str, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return normal forces (n,), compression positive, and tangential forces (n, 3) on the first grains, in N.

        Dashpot forces are not included.

        Args:
            scene: The scene.
            radii: Radii of the two grains, (2, n), in m.
            overlap: Overlaps, (n,), in m.
            columns: Known columns of history; `history_at` adds the missing columns.
        """
        history = self.history_at(overlap, columns)
        normal, composition = self._evaluate("normal_force", scene, radii, overlap, ZERO, history)
        forces = [history[name] for name, column in composition.columns.items() if column.is_force]
        return normal, functools.reduce(np.add, forces) if forces else np.zeros((len(overlap), 3))

    def elastic_energy(self, snapshot: Snapshot) -> float:
        """Return the total energy (J) of the springs, cohesion and bonds of all contacts."""
        spheres, scene = snapshot.spheres, cast("Scene", snapshot.scene)
        contacts = spheres.contacts
        history = self.history_at(contacts.overlap, self.history_of(contacts))
        normal = Vector(*contacts.normal.T)
        energy, _ = self._evaluate("stored_energy", scene, spheres.radii, contacts.overlap, normal, history)
        return float(energy.sum())

    def constraints(self, snapshot: Snapshot) -> np.ndarray:
        """Return the number of relative motions that each contact resists, (n,), from 1 to 6.

        The normal force counts 1; the tangential force 2, rolling 2 and twisting 1 unless they are at their limits.
        Raises InputError for cohesion and bonds, whose limits depend on more than the normal force.
        """
        spheres, scene = snapshot.spheres, cast("Scene", snapshot.scene)
        acting, contacts = self.acting(scene), spheres.contacts
        if "cohesion" in acting or "bond" in acting:
            raise InputError(f"the redundancy index needs a law without cohesion or bonds; {self.name} has them")
        along = np.einsum("ci,ci->c", contacts.rolling_moment, contacts.normal)
        bending = np.linalg.norm(contacts.rolling_moment - along[:, None] * contacts.normal, axis=1)
        limit = AT_LIMIT * np.abs(contacts.normal_force)
        counts = np.ones(len(contacts))
        if "tangential" in acting:
            counts += 2.0 * (np.linalg.norm(contacts.tangential_force, axis=1) < scene.friction * limit)
        for part, motions, moment in ((self.rolling, 2.0, bending), (self.twisting, 1.0, np.abs(along))):
            if part.kind in acting:
                counts += motions * (moment < part.limit(part.numbers(scene), *spheres.radii) * limit)
        return counts

    def history_of(self, contacts: Contacts) -> dict[str, np.ndarray]:
        """Return the history columns of a Snapshot's contacts, whose tangential force includes bond forces."""
        further = contacts.columns
        others = [further[name] for name, column in self.columns.items() if column.is_force and name in further]
        sliding = functools.reduce(np.subtract, others, contacts.tangential_force)
        return {"tangential_force": sliding, "rolling_moment": contacts.rolling_moment, **further}

    def _evaluate(
        self,
        name: str,
        scene: Scene,
        radii: np.ndarray,
        overlap: np.ndarray,
        normal: Vector,
        columns: Mapping[str, np.ndarray],
    ) -> tuple[np.ndarray, Composition]:
        """Evaluate a function of the composition by name for contacts at rest, (n,); return the composition, too."""
        composition = self.composition(scene)
        k, a, b, depth = cast("tuple[float, ...]", (self.normal_stiffness(scene, *radii), *radii, overlap))
        contact = Contact(k, a, b, depth, 0.0, ZERO, normal, ZERO, ZERO, ZERO)
        values = [columns[name] for name in composition.columns]
        history = composition.make_history(*(v if v.ndim == 1 else Vector(*v.T) for v in values))
        return on_arrays(getattr(composition, name))(contact, history, self.numbers(scene)), composition

    def damping_ratio(self, scene: Scene) -> float:
        """Return the damping ratio of the stiffest mode, which reduces the stable time step; 0 without dashpots."""
        return self.damping.ratio(scene) if "damping" in self.acting(scene) else 0.0

    def local_damping(self, scene: Scene) -> float | None:
        """Return the coefficient of local damping of the scene, or None without local damping."""
        return self.damping.local(scene) if "damping" in self.has else None

    def yade(self, scene: Scene) -> YadeLaw | None:
        """Return the same law in YADE, or None if YADE does not have this law."""
        return compose_yade(self, scene)

    @functools.cached_property
    def parameters(self) -> Mapping[str, Parameter]:
        """Parameters of a scene that a part of the law uses: name -> Parameter.

        A law with a user-defined part of a kind in DEFAULTS is assumed to use all parameters of labkit's parts except
        `rolling_friction`, `twisting_friction` and `limits`.
        """
        parts = {"normal": self.normal, "tangential": self.tangential, **self.parts_by_kind}
        used = {name: field for part in parts.values() for name, field in part.parameters.items()}
        if not all(is_labkits(type(part)) for kind, part in parts.items() if kind in DEFAULTS):
            assumed = PARAMETERS.keys() - {"rolling_friction", "twisting_friction", "limits"}
            used = {**{name: PARAMETERS[name] for name in assumed}, **used}
        return {name: named(name, field) for name, field in used.items()}

    @property
    def labkits(self) -> bool:
        """True if the law is part of labkit."""
        return is_labkits(type(self))


DEFAULTS: dict[str, LawPart] = {
    "normal": LinearSpring(),
    "tangential": Coulomb(),
    "rolling": Rolling(),
    "twisting": Twisting(),
    "damping": Dashpots(),
    "cohesion": Adhesion(),
    "bond": ParallelBond(),
}


def _require_parts(law: type[ContactLaw], parts: LawParts) -> None:
    """Raise InputError for a law without a normal part, or for a part with columns or losses that its kind lacks."""
    if "normal" not in parts:
        raise InputError(f"the contact law {law.__name__} has no normal part: add one, for example LinearSpring()")
    for kind in sorted(parts.keys() & set(SPECIAL) - {"normal"}):
        part, usual = parts[kind], DEFAULTS[kind]
        if (part.history.keys(), len(part.losses)) != (usual.history.keys(), len(usual.losses)):
            raise InputError(
                f"{type(part).__name__} has columns of history or losses that a {kind} part cannot have: make it a "
                "normal part or one of another kind"
            )


def on_arrays(function: Callable[..., object]) -> Callable[..., np.ndarray]:
    """Return a part's function, which is written for numbers, typed as a function of arrays."""
    return cast(Callable[..., np.ndarray], function)
