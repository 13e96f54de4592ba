"""`./lab initial-fabric`: runs the campaign, or uses the stored data, and writes results/initial_fabric."""

from __future__ import annotations

import math

import pandas
import xarray as xr

from analysis.initial_fabric.figures import balance_figure, directions_figure, twins_figure
from analysis.initial_fabric.loading import ANGLES, loading_of
from analysis.initial_fabric.response import BEFORE, coordination_table, direction_table, response_table, twin_table
from analysis.initial_fabric.states import balance_table, state_table
from analysis.statistics import in_bold
from analysis.study import Figures, StoredTables, Study, Tables, Values


class InitialFabric(Study):
    """What an isotropic stress hides: the fabric left by earlier shear, and Z at equal e and p."""

    data, title = "loading.nc", "What an isotropic stress hides: initial fabric and coordination number"
    reduce = staticmethod(loading_of)

    def tables(self, data: xr.Dataset) -> Tables:
        states, response = state_table(data), response_table(data)
        return {
            "states": states,
            "balance": balance_table(states[states["test"].isin(ANGLES)]),
            "response": response,
            "directions": direction_table(response),
            "coordination": coordination_table(response),
            "twins": twin_table(response),
        }

    def figures(self, data: xr.Dataset, tables: StoredTables) -> Figures:
        return {
            "balance": balance_figure(tables["states"]),
            "directions": directions_figure(data),
            "twins": twins_figure(data),
        }

    def numbers(self, tables: StoredTables) -> Values:
        effects = {name: beside_the_model(tables[name]) for name in ("directions", "coordination", "twins")}
        return {"balance": in_bold(tables["balance"]), **effects}


STUDY = InitialFabric()


def beside_the_model(rows: pandas.DataFrame) -> pandas.DataFrame:
    """Effects in the grains next to those in the model (model, model_within; NaN for BEFORE), and `bold`."""
    grains, model = (rows[rows["source"] == source].reset_index(drop=True) for source in ("grains", "model"))
    measured = ~grains["measure"].isin(BEFORE)
    grains["model"], grains["model_within"] = (model[key].where(measured, math.nan) for key in ("difference", "within"))
    return in_bold(grains)
