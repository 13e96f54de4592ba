"""`labkit picture`: draw grains and force chains in 3D."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from labkit.cli.arguments import Option
from labkit.cli.outputs import name_beside, require_outputs
from labkit.cli.registry import command
from labkit.files.netcdf import labkit_kind


@command("picture")
def picture_command(
    file: Annotated[str, Option("state or run file")],
    *,
    snapshot: Annotated[
        list[int] | None,
        Option(
            "snapshots of a run to draw, one below the other; negative numbers count from the end (default: -1)",
            "N",
            type=int,
        ),
    ] = None,
    output: Annotated[
        str | None,
        Option(
            "picture to write (default: next to the file); FILE.html: a page with a 3D view of all snapshots", "FILE"
        ),
    ] = None,
) -> None:
    """Draws the grains (left) and the contact forces (right) in 3D.

    Writes an image, or a page for a browser with a 3D view and a slider over the snapshots.

    Examples:
        labkit picture r.run.nc --snapshot 0 -1
        labkit picture r.run.nc -o r.html
    """
    from labkit.figures import plots
    from labkit.plugins.pictures.picture import draw_grains
    from labkit.plugins.pictures.viewer import Viewer
    from labkit.results.dataset import snapshots

    output = output or name_beside(file, ".picture.png")
    if Path(output).suffix.lower() == ".html":
        Viewer(snapshots(file, snapshot), Path(file).name).write(output)
        print(f"page: {output}")
        return
    require_outputs(output, None, ".html")
    numbers = snapshot or [-1] * (labkit_kind(file) == "run")
    plots.save(draw_grains(snapshots(file, numbers), Path(file).name), output, [file])
    print(f"picture: {output}")
