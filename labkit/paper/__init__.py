"""The tests of He, Wu & Wang (2019) from results/paper: data, figures, numbers."""

from pathlib import Path


def runs(folder):
    """name -> run (labkit.open_run) of the thin run files of `folder`, e.g. results/paper."""
    from labkit import open_run

    files = sorted((Path(folder) / "runs").glob("*.run.nc"))
    return {file.name.removesuffix(".run.nc"): open_run(file) for file in files}
