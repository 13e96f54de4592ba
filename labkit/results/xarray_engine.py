"""Lets xarray's open_dataset read run files with `engine="labkit"`; xarray finds this engine by itself."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import ClassVar, cast

import xarray as xr
from xarray.backends import BackendEntrypoint

from labkit.results.dataset import open_run


class RunFiles(BackendEntrypoint):
    """The xarray engine for run files of labkit, which opens them as labkit.open_run does."""

    description: ClassVar[str] = "Run files of labkit, with contacts and grains in one Dataset"
    open_dataset_parameters: ClassVar[tuple[str, ...] | None] = ("filename_or_obj", "drop_variables")

    def open_dataset(self, filename_or_obj: object, *, drop_variables: str | Iterable[str] | None = None) -> xr.Dataset:
        """Open a run file. Raises InputError if it is not a valid run file.

        Args:
            filename_or_obj: Name of the file.
            drop_variables: Variables to leave out.
        """
        run = open_run(cast("str | os.PathLike[str]", filename_or_obj))
        return run if drop_variables is None else run.drop_vars(drop_variables)
