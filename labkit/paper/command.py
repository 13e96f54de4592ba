"""`labkit paper`: results/paper from the folder of a campaign, or again from its own thin run files."""

from __future__ import annotations

import pandas

from labkit.campaign.collection import run_files
from labkit.errors import InputError
from labkit.files import labkit_kind, make_folder
from labkit.paper import runs
from labkit.paper.condense import condense
from labkit.provenance import write_told


def paper(campaign, output, command, progress):
    """Condenses the complete runs of the folder `campaign`, if one is given, and makes all tables from the thin files
    in `output`; returns the files that were written."""
    output = make_folder(output, "--output")
    (output / "runs").mkdir(exist_ok=True)
    if campaign:
        for k, file in enumerate(files := complete(campaign)):
            condense(file, output / "runs" / file.name, command)
            progress((k + 1) / len(files), f"run {k + 1} of {len(files)}")
    found = runs(output)
    written = [output / "campaign.csv"]
    write_told(written[0], costs(found).to_csv(index=False, float_format="%.6g"))
    return written


def complete(campaign):
    """The run files of a campaign that are finished. Raises InputError for none."""
    files = [file for file in run_files([campaign]) if labkit_kind(file) == "run"]
    if not files:
        raise InputError(f"{campaign} holds no finished runs: give the folder of labkit campaign paper")
    return files


def costs(found):
    """A row per run: what it took. wall_time in s, of whatever else the machine did too."""
    return pandas.DataFrame([
        {"run": name, "path": run.attrs["path"], "engine": run.attrs["engine"], "law": run.lab.scene.law,
         "grains": run.sizes["grain"], "records": run.sizes["time"], "steps": int(run.attrs["steps"]),
         "grain_steps": int(run.attrs["steps"]) * run.sizes["grain"], "wall_time": float(run.attrs["wall_time"])}
        for name, run in found.items()
    ])  # fmt: skip
