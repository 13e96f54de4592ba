"""`labkit stratified`: makes the layer of Fig. 3."""

from __future__ import annotations

import dataclasses
from pathlib import Path as File
from typing import Annotated

from labkit.cli.arguments import Csv, History, Instance, Option, Working
from labkit.cli.outputs import require_outputs, write_outputs
from labkit.cli.registry import command
from labkit.engines.base import Progress
from labkit.files.writable import require_writable
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.grains.state_file import read_state
from labkit.plugins.stratified.layer import SCENE, Layer, make_layer, strata
from labkit.process.progress import reporter
from labkit.simulation.tasks import Task, execute


@dataclasses.dataclass(frozen=True, kw_only=True)
class LayerTask(Task[State]):
    """Make the layer."""

    layer: Layer

    title = "layer"

    @property
    def scene(self) -> Scene:
        return SCENE

    def do(self, progress: Progress) -> State:
        return self.finish(make_layer(self.layer, self.device, progress))


@command("stratified")
def stratified_command(
    *,
    layer: Annotated[Layer, Instance(Layer, "layer")],
    computation: Working,
    output: Annotated[str, Option("state file to write", "FILE")] = "stratified.state.nc",
    figure: Annotated[str | None, Option("figure to write (default: next to the state file)", "FILE")] = None,
    csv: Csv = None,
    history: History,
) -> None:
    """Makes the layer of Fig. 3, a stratum of coarse discs over one of fine discs, and loads it biaxially.

    Writes a state file and a figure, and prints a table of the strata.

    Example:
        labkit stratified --size-ratio 2 -o layer.state.nc
    """
    import pandas

    from labkit.plugins.stratified.figure import stratified_layer

    drawn = figure or output.removesuffix(".state.nc") + ".png"
    require_outputs(drawn, csv)
    require_writable(output, "state")
    if not File(output).exists() or read_state(output).recipe != layer.to_json():
        made = execute(LayerTask(layer=layer, output=output, history=history, device=computation), reporter("layer"))
        print(f"{output}: {made.number_of_grains} grains")
    state = read_state(output)
    table = pandas.DataFrame([dataclasses.asdict(stratum) for stratum in strata(state)])
    print(table.T.to_string(header=False))
    write_outputs(stratified_layer(state), drawn, table, csv, [output])
