"""Saved YADE simulations (O.save): a YADE process loads the file and passes on grains, cell and contacts."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from labkit.engines.yade_process import find_script, run_script
from labkit.errors import PhysicsError
from labkit.exchange.answers import Answers
from labkit.exchange.formats import Format, damaged_file
from labkit.exchange.packing import COMPRESSION, RADIUS, SECOND, ContactList, Packing, stated_material

SCRIPT = "read_save.py"


class YadeSave(Format):
    """A save, in any format of YADE's. Normal and shear forces of YADE act on the second grain of a contact."""

    name = "yade_save"
    description = "save of a YADE simulation, read by YADE itself"
    endings = (".yade", ".yade.gz", ".yade.bz2", ".yade.xml", ".xml", ".xml.gz", ".xml.bz2", ".bin")

    def recognises(self, file: Path, head: str) -> bool:
        named = file.name.lower().endswith(self.endings)  # YADE's loader trusts a file: its text must not choose it
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
    """Return the Packing from the arrays that yade_scripts/read_save.py writes."""
    pairs = saved["pairs"].reshape(-1, 2)
    contacts = None
    if len(pairs):
        contacts = ContactList(
            grain=pairs,
            normal_force=saved["normal_force"],
            positive=COMPRESSION,
            tangential_force=saved["shear_force"].reshape(-1, 3),
            acts_on=SECOND,
            overlap=saved["overlap"] if np.isfinite(saved["overlap"]).all() else None,  # not saved by every YADE
        )
    cell = saved["cell"] if saved["cell"].size else None
    packing = Packing(
        saved["position"].reshape(-1, 3),
        saved["radius"],
        RADIUS,
        saved["id"],
        cell,
        None if cell is None else np.zeros(3),
        contacts,
    )
    clumped, others = int(saved["clumped"]), int(saved["others"])
    notes = [f"{clumped} grains are parts of clumps: they become separate grains"] if clumped else []
    notes += [stated_material(str(one).split()) for one in saved.get("materials", ()) if str(one)]
    return packing.noting(*notes, *([f"{others} bodies that are not spheres are left out"] if others else []))
