"""Every table of the paper's numbers, from the thin run files: written by one function."""

from __future__ import annotations

from pathlib import Path

from analysis.paper import fidelity, model_comparison, sources
from analysis.paper.causes import guarded_study
from analysis.paper.ends import Runs, ends, extrapolated, in_memory, main, sheared
from analysis.paper.engines import engine_table
from analysis.paper.lines import critical_Lambda, critical_lines, critical_Z, one_line
from analysis.paper.sff_errors import sff_errors
from labkit.io import make_folder, write_with_provenance


def write_tables(
    runs: Runs, output: str | Path, study: str | Path | None = None, command: str | None = None
) -> list[Path]:
    """Writes all tables into the folder `output` and returns their files.

    `runs`: name -> run (labkit.open_run); `study`: the study.nc of ./lab speed-error, whose effects of rate, time
    step, damping and size are tested causes too. What has no runs is said in the tables.
    """
    output = make_folder(output, "--output")
    known = in_memory(runs)
    numbers, causes = fidelity.fidelity(known, guarded_study(study and Path(study)))
    at_ends = ends(sheared(main(known)))
    at_ends = at_ends.assign(
        Z_off=at_ends["Z"] - critical_Z(at_ends["e"]), Lambda_off=at_ends["Lambda"] - critical_Lambda(at_ends["e"])
    )
    found, other = model_comparison.calibrate(known)
    errors, data = model_comparison.compare(known, model_comparison.models(found))
    tables = {
        "fidelity.csv": numbers,
        "fidelity_causes.csv": causes,
        "critical_states.csv": at_ends,
        "critical_extrapolated.csv": extrapolated(sheared(main(known))),
        "critical_lines.csv": critical_lines(at_ends),
        "one_critical_line.csv": one_line(at_ends),
        "sff.csv": sff_errors(runs),
        "parameters.csv": model_comparison.parameters(found, other),
        "model_errors.csv": errors,
        "engines.csv": engine_table(known),
    }
    texts = {name: table.to_csv(index=False, float_format="%.6g") for name, table in tables.items()}
    texts["fidelity.md"] = fidelity.page(numbers) + "\n"
    texts["model_errors.md"] = model_comparison.summary(errors) + "\n"
    if found:
        texts["calibrated.json"] = model_comparison.as_json(found)
    for name, text in texts.items():
        write_with_provenance(output / name, text, sources(runs), command)
    model_comparison.write_model(output / "model.nc", data, command)
    return [*(output / name for name in texts), output / "model.nc"]
