"""A YADE script that loads a State into a stock YADE, without labkit: grains, cell, contact history, material, law."""

from __future__ import annotations

import json
import math
from pathlib import Path

from labkit.errors import InputError
from labkit.exchange.formats import Format
from labkit.grains.state import State
from labkit.io.atomic import write_text

TEMPLATE = Path(__file__).with_name("load_in_yade.py.template")


class YadeScript(Format):
    """A self-contained Python script for YADE, for states with the rolling-resistance law of YADE."""

    name = "yade_script"
    description = "script that loads the grains and contacts into a stock YADE"
    endings = (".py",)

    def recognises(self, file: Path, head: str) -> bool:
        return False  # written, not read

    def write(self, state: State, file: Path) -> None:
        """Write grains, cell, contacts, material and engines. Raises InputError for another contact law.

        YADE's kn is 2 Ea Ra Eb Rb/(Ea Ra + Eb Rb), labkit's is pi E Ra Rb/(Ra + Rb); therefore `young` is (pi/2) E, and
        kt/kn is `poisson` (labkit.grains.laws.named.material).
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
