"""The stored tests as one data set, and its split into a training and a held-out part."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas
import xarray as xr

import labkit as lk
from analysis.curves import POINTS, accumulated_strain
from analysis.initial_fabric.loading import STRAIN, specimen_of
from analysis.netcdf import characters
from labkit.campaigns import read_campaign
from labkit.io import provenance_json, whole_file
from labkit.micro import symmetric
from labkit.paths import Steps, increments, path_from, path_to_json

SPLIT = Path(__file__).parent / "split.csv"
TENSORS = {
    "strain": "strain",
    "stress": "stress",
    "A": "contact_anisotropy",
    "F": "normal_force_anisotropy",
    "Ft": "mobilisation",
}
SCALARS = {"e": "void_ratio_nominal", "Z": "coordination_number", "Lambda": "mean_normalised_force"}
