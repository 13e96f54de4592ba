"""Output files of commands: default names built from the parameters, checks, figures and tables."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path as File
from typing import TYPE_CHECKING

from labkit.cli.arguments import Texts
from labkit.errors import as_typed
from labkit.files.provenance import write_with_provenance
from labkit.files.writable import require_different, require_writable, stem
from labkit.grains.scene import Scene
from labkit.parameters import options_of
from labkit.paths.path import Path
from labkit.specimens.recipe import SIDE, Recipe

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

IN_FRONT = ("void_ratio", "step1_friction", "step1_rolling_friction", "grains", "side", "seed")  # in every name
NUMBERS = (int, float, bool, tuple)
CONDITIONS = ("stop_when",)
WORDS = ("law", "preparation", "fabric")  # parameters whose value says what they are
SHORT = {
    "young_modulus": "E",
    "time_step_factor": "t",
    "friction": "mu",
    "rolling_friction": "mur",
    "strain": "e",
    "rate": "r",
    "reversals": "c",
}


def specimen_name(recipe: Recipe, scene: Scene) -> str:
    """Build the name of a state file from the recipe and the parameters of the scene that differ from Table 1."""
    size = f"n{recipe.grains}" if recipe.grains else f"l{SIDE if recipe.side is None else recipe.side:g}"
    parts = [
        *([] if recipe.void_ratio is None else [f"e{recipe.void_ratio:g}"]),
        f"f{recipe.step1_friction:g}",
        f"r{recipe.step1_rolling_friction:g}",
        size,
        f"s{recipe.seed}",
    ]
    for name, parameter in options_of(Recipe).items():
        value = getattr(recipe, name)
        if value != parameter.default and name not in IN_FRONT:
            parts.append(_part(name, value))
    for name, parameter in options_of(Scene).items():
        value = getattr(scene, name, parameter.default)
        if value != parameter.default and not (name == "mean_diameter" and scene.grading):
            parts.append(_part(name, value))
    return "_".join(parts) + ".state.nc"


def run_name(
    path: str,
    specimen: str,
    kind: type[Path],
    loading: Texts,
    material: Texts,
    settings: str | None = None,
    snapshot: int | None = None,
) -> str:
    """Build the name of a run file from the specimen, the path or path file, and the given parameters."""
    of_path = {name: _part(name, value) for name, value in _read(loading, kind).items()}
    parts = [_stem(specimen, snapshot), File(path).stem if File(path).suffix else kind.name]
    parts += [of_path.pop(name) for name in ("pressure", "strain", "rate") if name in of_path]
    parts += [settings] if settings is not None else []
    parts += [_part(name, value) for name, value in _read(material, Scene).items()]
    return str(File(specimen).with_name("_".join([*parts, *of_path.values()]) + ".run.nc"))


def _stem(specimen: str, snapshot: int | None) -> str:
    """Name a specimen: its file, and the number of the snapshot if it is not the end of a run."""
    return stem(specimen) + ("" if snapshot is None else f"_snapshot{snapshot}")


def _read(texts: Texts, kind: type) -> dict[str, object]:
    """Convert the given parameters of a dataclass to SI units; leave out free text other than conditions to stop."""
    parameters = options_of(kind)
    return {
        name: parameters[name].read(texts[name])
        for name in parameters
        if name in texts
        and (name in CONDITIONS or parameters[name].choices is not None or parameters[name].kind in NUMBERS)
    }


def _part(name: str, value: object) -> str:
    """Format a parameter as part of a file name."""
    if name in WORDS:
        return str(value)
    if name == "shape":
        return re.sub(r"[^\w.+-]+", "-", str(value).replace("=", ""))
    if name == "grading":
        return f"{str(value).split()[0]}-{_digest(value)}"
    if name in CONDITIONS:
        return f"{name}-{_digest(value)}"
    if name == "pressure" and isinstance(value, int | float):
        return f"p{value / 1e3:g}kPa"
    return SHORT.get(name, name) + (as_typed(value).replace(",", "_") if isinstance(value, tuple) else as_typed(value))


def _digest(value: object) -> str:
    """Return six characters that stand for a text that is no file name."""
    return hashlib.sha256(str(value).encode()).hexdigest()[:6]


def consolidated_name(specimen: str, pressure: float, cell: str | None = None, snapshot: int | None = None) -> str:
    """Build the name of the state file of a consolidated specimen, in the folder of the specimen; `cell` if given."""
    parts = [_stem(specimen, snapshot), _part("pressure", pressure), *([] if cell is None else [_part("cell", cell)])]
    return str(File(specimen).with_name(f"{'_'.join(parts)}.state.nc"))


def model_name(
    path: str,
    kind: type[Path],
    start: type,
    texts: Texts,
    law: str = "labkit",
    parameters: str | None = None,
    beyond: str = "error",
) -> str:
    """Build the name of a run file of the model, or of another constitutive law, from the given parameters.

    `parameters` is the file of the law's constants, and `beyond` how the model reads void ratios above e_cmax.
    """
    values = {**_read(texts, start), **_read(texts, kind)}
    parts = ["model" if law == "labkit" else law, path, *(_part(name, value) for name, value in values.items())]
    parts += [] if parameters is None else [File(parameters).stem]
    parts += [] if beyond == "error" else [beyond]
    return "_".join(parts) + ".run.nc"


def name_beside(file: str, ending: str) -> str:
    """Build the name of an output in the folder of a run, state or probes file; `ending` is such as `.verify.png`."""
    return str(File(file).with_name(stem(file) + ending))


def tell_replaced(file: str) -> None:
    """Print that the file will be replaced, if it exists."""
    if File(file).exists():
        print(f"{file} already exists and will be replaced", flush=True)


def require_outputs(figure: str, csv: str | None, *other: str) -> None:
    """Raise InputError if the figure or the CSV file cannot be written; `other` are further formats of the figure."""
    from labkit.figures.plots import require_format

    require_different(figure, csv)
    require_format(figure, *other)
    require_writable(figure)
    if csv:
        require_writable(csv)


def write_outputs(drawn: Figure, figure: str, table: pandas.DataFrame, csv: str | None, inputs: Sequence[str]) -> None:
    """Write a figure and print its name; write the data of the figure as a table if `csv` is given."""
    from labkit.figures.plots import save

    save(drawn, figure, inputs)
    print(f"figure: {figure}")
    write_table(table, csv, inputs)


def write_table(table: pandas.DataFrame, file: str | None, inputs: Sequence[str], digits: int = 5) -> None:
    """Write a table as CSV if a file is given; `inputs` are the files from which the table was made."""
    if file:
        write_with_provenance(file, table.to_csv(index=False, float_format=f"%.{digits}g"), inputs)
