"""`./lab stratified`: makes the layer of Fig. 3, and writes a state file, a figure and a table of the strata."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import cast

import pandas

from analysis.stratified.figure import stratified_layer
from analysis.stratified.layer import Layer, make_layer, strata
from labkit.cli.arguments import Instance, Made, device_of_options
from labkit.cli.parser import Parser
from labkit.engines import Device
from labkit.files import write_with_provenance
from labkit.grains import read_state, write_state
from labkit.process import reporter

SECTIONS = Instance(Layer, "layer"), Made(device_of_options)


def add_options(parser: Parser) -> None:
    """Adds the options of the layer, of the engine, and the name of the state file."""
    for section in SECTIONS:
        section.add(parser)
    parser.add_argument("-o", "--output", default="stratified.state.nc", help="state file to write")


def main(options: argparse.Namespace, command: str) -> int:
    """Makes the layer unless the state file has it; the figure and the table go next to the file."""
    layer, device = cast(tuple[Layer, Device], tuple(section.read(options) for section in SECTIONS))
    output, stem = options.output, options.output.removesuffix(".state.nc")
    if not Path(output).exists() or read_state(output).recipe != layer.to_json():
        write_state(output, make_layer(layer, device, reporter("layer")))
    state = read_state(output)
    table = pandas.DataFrame([dataclasses.asdict(stratum) for stratum in strata(state)])
    print(table.T.to_string(header=False))
    stratified_layer(state).savefig(f"{stem}.png")
    write_with_provenance(f"{stem}.csv", table.to_csv(index=False, float_format="%.5g"), [output], command)
    return 0
