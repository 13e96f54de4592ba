"""Files for users of the material law: sources, the table of PROPS, and an include file for Abaqus input."""

from __future__ import annotations

from pathlib import Path

from labkit.io.atomic import write_text
from labkit.umat.library import copy_sources
from labkit.umat.props import STATE_NAMES

TABLE, INCLUDE = "props.csv", "labkit_material.inp"


def props_table(props: dict[str, float]) -> str:
    """CSV of PROPS: number, name, value."""
    return "number,name,value\n" + "".join(
        f"{number},{name},{value!r}\n" for number, (name, value) in enumerate(props.items(), start=1)
    )


def abaqus_material(props: dict[str, float]) -> str:
    """Lines of an Abaqus input file that define the material LABKIT with these PROPS."""
    values = [f"{value!r}" for value in props.values()]
    rows = [", ".join(values[k : k + 8]) for k in range(0, len(values), 8)]
    names = [f"{number}, {name}, {name}" for number, name in enumerate(STATE_NAMES, start=1)]
    return "\n".join(
        [
            "*MATERIAL, NAME=LABKIT",
            f"*USER MATERIAL, CONSTANTS={len(values)}, UNSYMM",
            *rows,
            "*DEPVAR",
            f"{len(names)},",
            *names,
            "",
        ]
    )


def write(folder: Path, props: dict[str, float]) -> list[Path]:
    """Write the sources, the table and the include file to an existing folder; returns the files."""
    copy_sources(folder, len(props))
    write_text(folder / TABLE, props_table(props))
    write_text(folder / INCLUDE, abaqus_material(props))
    return sorted(folder / name for name in ("labkit_umat.f90", "labkit_mgis.c", TABLE, INCLUDE))
