"""Figures and tables that commands write, and checks that they can be written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from labkit.errors import InputError
from labkit.io.files import require_writable
from labkit.io.provenance import write_with_provenance

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


def tell_replaced(file: str) -> None:
    """Say that a file which is there will be replaced."""
    if Path(file).exists():
        print(f"{file}: is there already, and will be replaced", flush=True)


def require_outputs(figure: str, csv: str | None, *other: str) -> None:
    """Raise InputError if the figure, or the requested CSV file, cannot be written; `other` are further formats."""
    from labkit.figures.plots import require_format

    require_format(figure, *other)
    require_writable(figure)
    if csv:
        require_writable(csv)
        if Path(csv).resolve() == Path(figure).resolve():
            raise InputError(f"{csv} is given as both the figure and the CSV file: use two different names")


def write_outputs(drawn: Figure, figure: str, table: pandas.DataFrame, csv: str | None, inputs: Sequence[str]) -> None:
    """Write a figure and print its name, and write the table behind it if `csv` is given."""
    from labkit.figures.plots import save

    save(drawn, figure, inputs)
    print(f"figure: {figure}")
    write_table(table, csv, inputs)


def write_table(table: pandas.DataFrame, file: str | None, inputs: Sequence[str], digits: int = 5) -> None:
    """Write a table as CSV if a file is given; `inputs` are the files from which it was made."""
    if file:
        write_with_provenance(file, table.to_csv(index=False, float_format=f"%.{digits}g"), inputs)
