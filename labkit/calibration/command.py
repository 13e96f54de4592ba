"""`labkit calibrate`: fit the parameters of the constitutive model to runs."""

from __future__ import annotations

import os
from typing import Annotated

from labkit.cli.arguments import Csv, Option
from labkit.cli.outputs import tell_replaced, write_table
from labkit.cli.registry import command
from labkit.cli.verify import runs_by_name
from labkit.errors import InputError
from labkit.io.files import require_writable


@command("calibrate")
def calibrate_command(
    run: Annotated[list[str], Option("run file of a simulation: shear tests, preferably also isoc and isod")],
    *,
    output: Annotated[
        str | None, Option("write the fitted parameters as JSON, for labkit model --parameters", "FILE")
    ] = None,
    csv: Csv = None,
    figure: Annotated[str | None, Option("draw the runs and the fitted model, to this file", "FILE")] = None,
) -> None:
    """Fits the parameters of the constitutive model to runs.

    Prints a report, and writes the parameters, a table and a figure if asked to.

    Example:
        labkit calibrate cv.run.nc cp.run.nc isoc.run.nc isod.run.nc -o fitted.json --figure fit.png
    """
    from labkit.calibration.figure import draw_fit
    from labkit.calibration.fitting import fit
    from labkit.calibration.observation import observe, require_usable
    from labkit.figures import plots
    from labkit.io.provenance import write_with_provenance

    opened = runs_by_name(run)
    runs, left_out = require_usable(opened)
    files = [file for file, name in zip(run, opened, strict=True) if name in runs]
    outputs = [file for file in (output, csv, figure) if file]
    if len(set(map(os.path.realpath, outputs))) < len(outputs):
        raise InputError("two outputs have the same name: give each file its own")
    if figure:
        plots.require_format(figure)
    for file in outputs:
        require_writable(file)
        tell_replaced(file)
    observations = [observe(name, run) for name, run in runs.items()]
    result = fit(observations)
    print(*(f"left out: {name}: {reason}\n" for name, reason in left_out.items()), sep="", end="")
    print(result.report())
    if output:
        write_with_provenance(output, result.model.reading(beyond_e_cmax="error").to_json() + "\n", files)
    write_table(result.table, csv, files, digits=6)
    if figure:
        plots.save(draw_fit(observations, result.predicted), figure)
    for file in outputs:
        print(f"written: {file}")
