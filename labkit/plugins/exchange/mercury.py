"""Restart files of MercuryDPM 0.11 and later: grains, periodic or Lees-Edwards boundaries, and interactions."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.plugins.exchange.contact_list import ContactList
from labkit.plugins.exchange.formats import Format, damaged_file
from labkit.plugins.exchange.packing import FIRST, RADIUS, Answers, Packing, stated_material
from labkit.text.reading import real, text_of, whole

DOMAIN = re.compile(r"xMin (\S+) xMax (\S+) yMin (\S+) yMax (\S+) zMin (\S+) zMax (\S+)")
OLD = re.compile(r"restart_version\s+(\S+)")
NEW_DOMAIN = re.compile(r"\bmin (\S+) (\S+) (\S+) max (\S+) (\S+) (\S+)")


SPHERES = {"BaseParticle", "SphericalParticle", "ThermalParticle", "LiquidFilmParticle"}


class MercuryRestart(Format):
    """A restart file. Sizes are radii; the force of an interaction acts on the first of the two particles."""

    name = "mercury"
    description = "restart file of MercuryDPM"
    endings = (".restart",)

    def recognises(self, file: Path, head: str) -> bool:
        return head.startswith(("MercuryDPM", "restart_version")) or ("restartFile" in head and "Species" in head)

    def read(self, file: Path, answers: Answers) -> Packing:
        text = text_of(file)
        if old := OLD.match(text):
            raise InputError(
                f"{file} is a restart file of a MercuryDPM before 0.11 (restart_version {old[1]}): write it again with "
                "a later MercuryDPM, whose files begin with its version"
            )
        lines = text.splitlines()
        try:
            particles = [line.split() for line in section(lines, "Particles")]
            interactions = [line.split() for line in section(lines, "Interactions")]
            position = np.array([after(words, "position", 3) for words in particles])
            radius = np.array([after(words, "radius", 1)[0] for words in particles])
            identity = np.array([whole(repr(after(words, "id", 1)[0])) for words in particles])
            cell, origin, tilt, notes = _cell_and_origin(lines)
            pairs = [words for words in interactions if "particleIds" in words]
            ids = [[whole(repr(number)) for number in after(words, "particleIds", 2)] for words in pairs]
            grains = np.array(ids, dtype=np.int64).reshape(-1, 2)
            force = np.array([after(words, "force", 3) for words in pairs]).reshape(-1, 3)
        except (ValueError, IndexError, OverflowError) as error:
            raise damaged_file(file, error) from None
        contacts = ContactList(grains, force=force, acts_on=FIRST) if len(grains) else None
        packing = Packing(position, radius, RADIUS, identity, cell=cell, origin=origin, tilt=tilt, contacts=contacts)
        walls = len(interactions) - len(pairs)
        others = sorted({words[0] for words in particles} - SPHERES)
        shapes = [f"{', '.join(others)} of the file become spheres with their radius"] if others else []
        species = [line.split()[3:] for line in section(lines, "Species") if len(line.split()) > 3]
        notes += [stated_material(words) for words in species[:1]]
        return packing.with_notes(*notes, *shapes, *([f"{walls} contacts with walls are left out"] if walls else []))


def section(lines: list[str], name: str) -> list[str]:
    """Return the lines of a section, which begins with its name and the number of lines; empty if it is missing.

    Raises ValueError if another number of lines follows.
    """
    for number, line in enumerate(lines):
        words = line.split()
        if len(words) == 2 and words[0] == name:
            count, rows = whole(words[1]), [row for line in lines[number + 1 :] if (row := line.split())]
            same = [row[0] == rows[0][0] for row in rows]
            follow = next((k for k, row in enumerate(rows) if len(row) == 2 or (k >= count and not same[k])), len(rows))
            if follow != count:
                raise ValueError(f"it states {count} {name}, but {follow} rows follow")
            return [" ".join(row) for row in rows[:count]]
    return []


def after(words: list[str], name: str, count: int) -> list[float]:
    """Return the `count` numbers that follow a name. Raises ValueError if the name or a number is missing."""
    if name not in words or len(words) <= words.index(name) + count:
        raise ValueError(f"a line lacks {name} and {count} numbers")
    first = words.index(name) + 1
    return [real(word) for word in words[first : first + count]]


def _cell_and_origin(lines: list[str]) -> tuple[np.ndarray | None, np.ndarray | None, float, list[str]]:
    """Return (cell, origin, tilt, notes) from domain and boundaries; cell is None if a direction is not periodic."""
    text = "\n".join(lines[:30])
    low, high = np.zeros((2, 3))
    if domain := DOMAIN.search(text):
        low, high = np.reshape([real(word) for word in domain.groups()], (3, 2)).T
    elif new := NEW_DOMAIN.search(text):
        low, high = np.reshape([real(word) for word in new.groups()], (2, 3))
    tilt, periodic = 0.0, [False, False, False]
    for words in (line.split() for line in section(lines, "Boundaries")):
        if words[0] == "PeriodicBoundary":
            normal = np.array(after(words, "normal", 3))
            axis = int(np.argmax(np.abs(normal)))
            low[axis], high[axis] = after(words, "distanceLeft", 1)[0], after(words, "distanceRight", 1)[0]
            periodic[axis] = True
        elif words[0] == "LeesEdwardsBoundary":
            low[0], high[0] = after(words, "left", 1)[0], after(words, "right", 1)[0]
            low[1], high[1] = after(words, "down", 1)[0], after(words, "up", 1)[0]
            width = high[0] - low[0]
            tilt = (after(words, "shift", 1)[0] + 0.5 * width) % width - 0.5 * width
            periodic[0] = periodic[1] = True
    if not all(periodic):
        axes = ", ".join(axis for axis, is_periodic in zip("xyz", periodic, strict=True) if not is_periodic)
        return None, None, tilt, [f"the domain is not periodic in {axes}: the box given must be wide enough there"]
    cell = np.diag(high - low)
    cell[0, 1] = tilt
    return cell, low, tilt, []
