"""`labkit probe`: applies small increments of strain or stress to one state of the grains or of the model."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Annotated

from labkit.cli.arguments import FROM, FromSnapshot, History, Instance, Made, Option, Working
from labkit.cli.model import BeyondECmax, ModelParameters
from labkit.cli.outputs import name_beside, write_table
from labkit.cli.registry import command
from labkit.engines import Device
from labkit.errors import InputError
from labkit.files.writable import require_writable
from labkit.grains.state import State
from labkit.grains.state_file import read_state
from labkit.plugins.probes.probing import Probing

if TYPE_CHECKING:
    from labkit.plugins.probes.probe_set import Probes


@dataclasses.dataclass(frozen=True, kw_only=True)
class MoreMaterials:
    """Materials that are probed in addition to the grains."""

    elastic: Annotated[
        bool,
        Option(
            "also probe the grains with friction coefficients so high that no contact slides", group="more materials"
        ),
    ] = False
    model: Annotated[
        bool, Option("also probe the constitutive model in the state that the grains have", group="more materials")
    ] = False
    beyond_e_cmax: BeyondECmax = "error"
    parameters: ModelParameters = None

    def __post_init__(self) -> None:
        """Raises InputError for an option of the model, if it is not probed."""
        for field in ("beyond_e_cmax", "parameters"):
            if not self.model and getattr(self, field) != getattr(MoreMaterials, field):
                raise InputError("is for the model: leave it out, or add --model", field=field)


@command("probe")
def probe_command(
    file: Annotated[str, Option(FROM)],
    *,
    from_snapshot: FromSnapshot = None,
    probing: Annotated[Probing, Instance(Probing, "probes")],
    materials: Annotated[MoreMaterials, Made(MoreMaterials)],
    computation: Working,
    output: Annotated[
        str | None, Option("probes file to write, or a table if its name ends in .csv (default: next to FILE)", "FILE")
    ] = None,
    history: History,
) -> None:
    """Applies small increments of strain or stress in many directions, each to the same state.

    Writes a probes file with all increments, and prints the range of the stiffness and the symmetry of its fit.
    `labkit figure envelope` draws the file.

    Examples:
        labkit probe r.run.nc --elastic --model -o e.probes.nc
        labkit probe s.state.nc --plane all --elastic
    """
    state = read_state(file, snapshot=from_snapshot)
    computation.require_scene(state.scene)
    output = output or name_beside(file, ".probes.nc")
    as_table = output.lower().endswith(".csv")
    require_writable(output, None if as_table else "probes")
    probes = probe_all(state, probing, materials, computation)
    if as_table:
        write_table(probes.table(), output, [file], digits=8)
    else:
        probes.write(output, [file], history)
    print(f"{output}: {probes!r}")
    print(summary_text(probes))
    if materials.elastic and probes.plane.name == "xz-shear" and probing.directions > 2:
        modulus = probes.of("elastic").shear_modulus()
        print(f"shear modulus G = {modulus / 1e6:.4g} MPa, half of the elastic stiffness in the direction of the shear")


def summary_text(probes: Probes) -> str:
    """Format the summary, with the stiffness in MPa or the compliance in 1/GPa."""
    name, factor, unit = ("stiffness", 1e-6, "MPa") if probes.kind == "strain" else ("compliance", 1e9, "1/GPa")
    table = probes.summary()
    for column in ("least", "largest"):
        table[column] *= factor
    names = {"least": f"least {name} ({unit})", "largest": f"largest ({unit})", "over_affine": "over affine bound"}
    names |= {"sliding_loss": "sliding loss (J/m3)", "contacts_changed": "contacts changed", "starts": "start states"}
    return table.rename(columns=names).to_string(index=False, float_format="%.3g", na_rep="-")


def probe_all(state: State, probing: Probing, materials: MoreMaterials, computation: Device) -> Probes:
    """Probe all requested materials; the model comes first because it may refuse the state."""
    from labkit.model.run_file import read_model
    from labkit.model.state import state_of
    from labkit.plugins.probes.grains import at_rest, probes_of
    from labkit.plugins.probes.model import probe_model
    from labkit.process.progress import reporter

    chosen = materials.model
    model = read_model(materials.parameters).reading(beyond_e_cmax=materials.beyond_e_cmax) if chosen else None
    if model is not None:
        model = dataclasses.replace(model, young_modulus=state.scene.young_modulus)
    start = at_rest(state, computation)
    predicted = None if model is None else probe_model(state_of(start.snapshot()), model, probing)
    probes = probes_of(start, probing, False, computation, reporter("probes"))
    if materials.elastic:
        probes += probes_of(start, probing, True, computation, reporter("elastic probes"))
    return probes if predicted is None else probes + predicted
