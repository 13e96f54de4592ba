"""Files of YADE: saves (O.save), SpherePack text, and a script that loads a State into a stock YADE."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import tempfile
from pathlib import Path

import numpy as np

from labkit.engines.yade import find_script, run_script
from labkit.errors import InputError, PhysicsError
from labkit.files.atomic import write_text
from labkit.grains.state import State
from labkit.plugins.exchange.contact_list import ContactList
from labkit.plugins.exchange.formats import Format, damaged_file
from labkit.plugins.exchange.packing import COMPRESSION, RADIUS, SECOND, Answers, Packing, stated_material
from labkit.plugins.exchange.tables import grains_in
from labkit.text.reading import real, text_of

SCRIPT = "read_save.py"


class YadeSave(Format):
    """A saved simulation in any of YADE's formats. YADE's normal and shear forces act on the second grain."""

    name = "yade_save"
    description = "save of a YADE simulation, read by YADE itself"
    endings = (".yade", ".yade.gz", ".yade.bz2", ".yade.xml", ".xml", ".xml.gz", ".xml.bz2", ".bin")

    def recognises(self, file: Path, head: str) -> bool:
        named = file.name.lower().endswith(self.endings)  # YADE's loader trusts files: only a file name may select it
        return ".yade" in file.name or (named and "boost_serialization" in head and "scene" in head)

    def read(self, file: Path, answers: Answers) -> Packing:
        with tempfile.TemporaryDirectory() as folder:
            output = Path(folder) / "grains.npz"
            try:
                run_script(find_script(SCRIPT), [str(file.resolve()), str(output)])
            except PhysicsError as error:
                raise damaged_file(file, f"YADE cannot load it: {error}") from None
            with np.load(output) as arrays:
                saved = {name: arrays[name] for name in arrays.files}
        return packing_of(saved)


def packing_of(saved: dict[str, np.ndarray]) -> Packing:
    """Make a Packing from the arrays that yade_scripts/read_save.py writes."""
    packing = Packing(saved["position"].reshape(-1, 3), saved["radius"], RADIUS, saved["id"], saved["clump"])
    if saved["cell"].size:
        packing = dataclasses.replace(packing, cell=saved["cell"], origin=np.zeros(3))
    if len(pairs := saved["pairs"].reshape(-1, 2)):
        contacts = ContactList(
            grain=pairs,
            normal_force=saved["normal_force"],
            positive=COMPRESSION,
            tangential_force=saved["shear_force"].reshape(-1, 3),
            acts_on=SECOND,
            overlap=saved["overlap"] if np.isfinite(saved["overlap"]).all() else None,  # not saved by some versions
        )
        packing = dataclasses.replace(packing, contacts=contacts)
    others = int(saved["others"])
    notes = [stated_material(str(material).split()) for material in saved.get("materials", ()) if str(material)]
    return packing.with_notes(*notes, *([f"{others} bodies that are not spheres are left out"] if others else []))


MARK = "##PERIODIC::"
BOX = re.compile(rf"^[ \t]*{MARK}[ \t]+(\S+)\s+(\S+)\s+(\S+)", re.MULTILINE)


class SpherePack(Format):
    """Text written by SpherePack.save; below the first line, a header or --columns may name other columns.

    The box is a cuboid with a corner at the origin; there are no contacts.
    """

    name = "sphere_pack"
    description = "text of YADE's SpherePack, with its periodic box"
    endings = (".spheres",)

    def recognises(self, file: Path, head: str) -> bool:
        return head.lstrip().startswith(MARK)

    def read(self, file: Path, answers: Answers) -> Packing:
        text = text_of(file)
        packing = grains_in(text, file, answers, ("x", "y", "z", "radius", "body"))
        if (box := BOX.search(text)) is None:
            return packing
        try:
            cell = np.diag([real(word) for word in box.groups()])
        except ValueError as error:
            raise damaged_file(file, error) from None
        note = "a SpherePack states the lengths of its cell only: if YADE had sheared the cell, give it with --box"
        return dataclasses.replace(packing, cell=cell, origin=np.zeros(3)).with_notes(note)

    def write(self, state: State, file: Path) -> None:
        """Write the grains in metres. Raises InputError for a cell that is not a cuboid along the axes."""
        lengths = np.diag(state.cell)
        if np.abs(state.cell - np.diag(lengths)).max() > 1e-9 * lengths.max():
            raise InputError(
                f"{file}: a SpherePack has no sheared cell: choose --format lammps_data or ondem, or make the specimen "
                "with --cell fixed"
            )
        lines = [" ".join([MARK, *map(repr, lengths.tolist())])]
        rows = np.column_stack([state.position, state.radius]).tolist()
        lines += [" ".join(map(repr, row)) for row in rows]
        write_text(file, "\n".join(lines) + "\n")


TEMPLATE = Path(__file__).with_name("load_in_yade.py.template")


class YadeScript(Format):
    """A self-contained Python script for YADE; the state must have YADE's rolling-resistance law."""

    name = "yade_script"
    description = "script that loads the grains and contacts into a stock YADE"
    endings = (".py",)
    keeps_contacts = True

    def write(self, state: State, file: Path) -> None:
        """Write grains, cell, contacts, material and engines. Raises InputError for any other contact law.

        kn is 2 Ea Ra Eb Rb/(Ea Ra + Eb Rb) in YADE and pi E Ra Rb/(Ra + Rb) in labkit; therefore `young` is (pi/2) E.
        `poisson` is kt/kn (labkit.grains.laws.named.material).
        """
        scene = state.scene
        if scene.law != "rolling_resistance" or scene.planar:
            raise InputError(f"{file}: the script has only the rolling_resistance law of spheres, not {scene.law}")
        if scene.twisting_friction > 0.0:
            raise InputError(f"{file}: the script has no twisting resistance: set twisting_friction to 0")
        text = TEMPLATE.read_text().format(
            name=file.name,
            radius=json.dumps(state.radius.tolist()),
            position=json.dumps(state.position.tolist()),
            velocity=json.dumps(state.velocity.tolist()),
            spin=json.dumps(state.angular_velocity.tolist()),
            pairs=[tuple(pair) for pair in state.contact_grain.tolist()],
            shear=json.dumps((-state.tangential_force).tolist()),
            moment=json.dumps((-state.rolling_moment).tolist()),
            cell=", ".join(map(repr, state.cell.ravel().tolist())),
            young=0.5 * math.pi * scene.young_modulus,
            poisson=1.0 / scene.stiffness_ratio,
            density=scene.density,
            angle=math.atan(scene.friction),
            rolls=scene.rolling_friction > 0.0,
            eta=0.5 * scene.rolling_limit_scale * scene.rolling_friction,
            damping=scene.local_damping,
            time_step=state.time_step or scene.time_step,
        )
        write_text(file, text)
