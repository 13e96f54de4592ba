"""`labkit speed-error`: runs a study, or goes on with it, and writes its data, figures and page."""

from __future__ import annotations

import shutil
from pathlib import Path

from labkit.visuals import plots
from labkit.io.files import make_folder, whole_file
from labkit.io.provenance import tell, write_told
from labkit.study import figures
from labkit.study.design import DESIGNS
from labkit.study.errors import errors
from labkit.study.jobs import run_study
from labkit.study.measures import measure_others
from labkit.study.page import page
from labkit.study.table import collect, open_study, restore


def speed_error(design_name, work, output, jobs, progress, earlier=None):
    """Runs the design in the folder `work`, writes the folder `output`; returns the files. `earlier`: the study.nc of a
    study whose tests need not be repeated."""
    design = DESIGNS[design_name]()
    if earlier:
        with open_study(earlier) as data:
            restore(data, design, work)
    make_folder(output, "--output")
    run_study(design, work, jobs, progress)
    measures = measure_others(design, work, progress)
    return write(design, work, Path(output), measures, f"./lab speed-error --design {design_name}")


def write(design, work, output, measures, command):
    data = collect(design, work)
    table = errors(data, measures["settings"])
    # text as characters: HDF5 breaks on strings of a file that is opened twice
    characters = {name: {"dtype": "S1"} for name, column in data.variables.items() if column.dtype.kind in "UO"}
    with whole_file(output / "study.nc") as temporary:
        data.to_netcdf(temporary, encoding=characters)
    tell(output / "study.nc")
    write_told(output / "errors.csv", table.to_csv(index=False, float_format="%.5g"), [output / "study.nc"])
    for file in sorted((Path(work) / "measures").iterdir()):
        if file.name != "model.csv":  # the lines of model_speed.txt
            shutil.copyfile(file, output / file.name)
            if file.suffix != ".png":
                tell(output / file.name)
    drawn = {"pareto_cp.png": figures.pareto(table), "pareto_cv.png": figures.pareto(table, "cv"),
             "changes.png": figures.changes(table), "sizes.png": figures.sizes(table)}  # fmt: skip
    for name, figure in drawn.items():
        plots.save(figure, output / name)
    made_of = [output / "study.nc", output / "errors.csv"]
    write_told(output / "README.md", page(data, table, measures, command), made_of)
    return sorted(output.iterdir())
