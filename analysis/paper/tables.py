"""All tables of results/paper, written from the reduced run files."""

from __future__ import annotations

from pathlib import Path

from analysis.pages import render
from analysis.paper import fidelity, model_comparison, report_numbers, sources
from analysis.paper.causes import guarded_study
from analysis.paper.ends import Runs, ends, extrapolated, in_memory, main, sheared
from analysis.paper.engines import engine_table
from analysis.paper.lines import critical_lines, off_the_lines, one_line
from analysis.paper.sff_errors import c0_bias, c0_errors, sff_errors
from analysis.paper.stationarity import components, stationarity
from labkit.engines import Progress
from labkit.files import make_folder, write_with_provenance

HERE = Path(__file__).parent


def write_tables(
    runs: Runs,
    output: str | Path,
    study: str | Path | None = None,
    command: str | None = None,
    progress: Progress = lambda fraction, text: None,
) -> list[Path]:
    """Writes all tables into the folder `output` and returns their files.

    `runs`: name -> run (labkit.open_run); `study`: study.nc of ./lab speed-error; whose effects of rate, time step,
    damping and size are also tested as causes; `progress`: called with (fraction, text). Entries without runs are
    marked as such in the tables.
    """
    folder = Path(make_folder(output, "--output"))
    progress(0.0, f"reading {len(runs)} runs")
    known = in_memory(runs)
    progress(0.1, "comparing the paper's numbers with ours")
    numbers, causes = fidelity.fidelity(known, guarded_study(Path(study) if study else None))
    progress(0.4, "critical states")
    at_ends = off_the_lines(ends(sheared(main(known))))
    slopes, drifts = stationarity(sheared(main(known)))
    of_c0 = c0_errors(main(known))
    progress(0.5, "calibrating the model")
    found, other = model_comparison.calibrate(known)
    progress(0.8, "comparing the model with the simulations")
    errors = model_comparison.compare(known, model_comparison.models(found))
    tables = {
        "fidelity.csv": numbers,
        "fidelity_causes.csv": causes,
        "critical_states.csv": at_ends,
        "critical_extrapolated.csv": extrapolated(sheared(main(known))),
        "critical_lines.csv": critical_lines(at_ends),
        "one_critical_line.csv": one_line(at_ends),
        "components.csv": components(at_ends),
        "slopes.csv": slopes,
        "stationarity.csv": drifts,
        "c0_errors.csv": of_c0,
        "c0_bias.csv": c0_bias(of_c0),
        "sff.csv": sff_errors(runs),
        "parameters.csv": model_comparison.parameters(found, other),
        "model_errors.csv": errors,
        "engines.csv": engine_table(known),
    }
    texts = {name: table.to_csv(index=False, float_format="%.6g") for name, table in tables.items()}
    pages = {"fidelity": report_numbers.fidelity(numbers), "model": report_numbers.model_errors(errors)}
    for name in ("fidelity.md", "model_errors.md"):
        texts[name] = render(HERE / name, {**pages, "box": lambda text, label: text})
    if found:
        texts["calibrated.json"] = model_comparison.as_json(found)
    for name, text in texts.items():
        write_with_provenance(folder / name, text, sources(runs), command)
    progress(1.0, "tables written")
    return [folder / name for name in texts]
