"""`labkit calibrate`: fit the parameters of the constitutive model to runs."""

from __future__ import annotations

from typing import Annotated

from labkit.cli.arguments import Csv, Option
from labkit.cli.outputs import tell_replaced, write_table
from labkit.cli.registry import command
from labkit.cli.verify import runs_by_name
from labkit.files.writable import require_different, require_writable


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
    from labkit.figures import plots
    from labkit.files.provenance import write_with_provenance
    from labkit.plugins.calibration.figure import draw_fit
    from labkit.plugins.calibration.fitting import calibrate
    from labkit.plugins.calibration.observation import observe

    outputs = require_different(output, csv, figure)
    if figure:
        plots.require_format(figure)
    for file in outputs:
        require_writable(file)
        tell_replaced(file)
    opened = runs_by_name(run)
    result = calibrate(opened)
    files = [file for file, name in zip(run, opened, strict=True) if name in result.predicted]
    print(result.report())
    if output:
        write_with_provenance(output, result.model.reading(beyond_e_cmax="error").to_json() + "\n", files)
    write_table(result.table, csv, files, digits=6)
    if figure:
        drawn = draw_fit([observe(name, opened[name]) for name in result.predicted], result.predicted)
        plots.save(drawn, figure, files)
    for file in outputs:
        print(f"written: {file}")
