"""Where the tables of a laboratory's file are: lines of headers, units below or in them, and rows.

A file may have titles above its table, and several tables one below the other. A group of an AGS4 file is such a
table, whose lines have labels. Columns can also be given by their numbers, #1, #2, ..., if there are no headers.
"""

from __future__ import annotations

import collections
import csv
import dataclasses
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path as File

from labkit.errors import InputError, nearest
from labkit.io.text import BLANKS, SEPARATORS, is_numeral, same, split, text_of
from labkit.laboratory_data.units import is_unit, unit_in_header

MARKS = (*SEPARATORS[1:], BLANKS, "|", ",")  # between columns; a comma may also be a decimal mark
BY_NUMBER = re.compile(r"#(\d+)")  # a column, counted from 1
MISSING = re.compile(r"(?i)n\.?/?a\.?|nan|null|none|[?*]|#(?:[a-z]+|div/0|n/a)[!?]?")  # text for a missing value
DIGITS = "+-.,0123456789"  # no header consists of cells that begin like numbers
COMMENTED = ("#", "%", "!", "//", "*")  # characters before headers in a comment
FEW = 2  # least number of numbers in a row of a table
LOOK = 500  # number of lines that are searched for headers, for a message
MOST_LINES = 20  # largest number of lines in a cell in quotes
MOST_UNITS = 3  # largest number of lines with units and other text below headers

Row = tuple[int, list[str]]  # number of the line, from 1, and its cells


def numbered_rows(text: str, separator: str | None) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number, from 1, and the cells of each record of a table; cells in quotes may have newlines.

    `separator` is None for blanks, or BLANKS for two or more of them. Raises InputError if a quote is not closed.
    """
    lines = text.split("\n")
    if separator in (None, BLANKS) or '"' not in text:
        yield from ((number, split(line, separator)) for number, line in enumerate(lines, 1) if line.strip())
        return
    reader, before = csv.reader((line + "\n" for line in lines), delimiter=separator, skipinitialspace=True), 0
    for cells in reader:
        if reader.line_num - before > MOST_LINES:
            raise InputError(f"line {before + 1} opens a quote that is not closed: repair the table")
        if cells:
            yield before + 1, [cell.strip() for cell in cells]
        before = reader.line_num


@dataclasses.dataclass(frozen=True)
class LaboratoryTable:
    """One table of a file.

    Args:
        line: Number of the line of its headers, from 1; 0 if it has none.
        headers: Headers, as `key` returns them.
        above: Text of the lines above the headers.
        rows: Rows below the headers, without units and empty rows.
        units: Header -> unit that the file states.
        notes: What was left out.
        blanks: True if blanks separate the columns, so that no cell can be empty.
    """

    line: int
    headers: list[str]
    above: list[str]
    rows: list[Row]
    units: dict[str, str]
    notes: list[str]
    blanks: bool = False

    @property
    def title(self) -> str:
        """The number of the line of the headers, and the text above them."""
        return f"line {self.line}" + (f" {self.above[-1][:40]!r}" if self.above else "")

    def place(self, wanted: str) -> int:
        """Return the index of a column, given by its header or number. Raises InputError."""
        if key(wanted) in self.headers:
            return self.headers.index(key(wanted))
        number = int(wanted[1:]) if BY_NUMBER.fullmatch(wanted) else 0
        if not 1 <= number <= len(self.headers):
            raise InputError(field="column", value=wanted, allowed=f"#1 to #{len(self.headers)}, or headers")
        return number - 1


def key(header: str) -> str:
    """Normalise a header, so that headers that look the same are equal, also where a blank stands before a bracket."""
    return re.sub(r"\s+(?=[\[(])", "", same(header))


def blocks_in(file: File, wanted: Sequence[str], group: str | None) -> list[LaboratoryTable]:
    """Return the tables of a file that have the headers `wanted`. Raises InputError if there is none.

    `group` is the group of an AGS4 file.
    """
    if not file.exists():
        raise InputError(f"{file} does not exist: give the file of a measured test")
    names = [one for one in wanted if not BY_NUMBER.fullmatch(one)]
    text = text_of(file, "export the table of the test as CSV", names)
    if not text.strip():
        raise InputError(f"{file} is empty: give the file of a measured test")
    if text.lstrip().startswith(("<", "{")):
        raise InputError(f"{file} is XML, HTML or JSON: export the table of the test as CSV")
    if group is not None:
        return [_group(text, file, wanted, group)]
    found = [(mark, *one) for mark in _marks(text) if (one := _starts(text, mark, wanted, bool(names)))]
    if not found:
        raise _not_found(text, file, names) if names else InputError(f"{file} has no rows of numbers: give a table")
    mark, rows, starts = max(found, key=lambda one: _fit(one[1], one[2]) if names else (_share(one[1][one[2][0] :]), 0))
    if not names:
        return [_without_headers(rows, starts[0])]
    firsts = [0, *(_last_row(rows, start, end) + 1 for start, end in itertools.pairwise(starts)), len(rows)]
    parts = zip(itertools.pairwise(firsts), starts, strict=True)
    tables = [_block(file, rows[first:end], start - first, wanted) for (first, end), start in parts]
    return [dataclasses.replace(one, blanks=mark in (None, BLANKS)) for one in tables]


def _marks(text: str) -> list[str | None]:
    """Return the separators that may separate the columns of a text."""
    return [mark for mark in MARKS if mark is None or mark in text]


def _starts(text: str, mark: str | None, wanted: Sequence[str], named: bool) -> tuple[list[Row], list[int]] | None:
    """Return the rows of a text and the indices of its headers, or, without any, of the first row of numbers."""
    rows = list(numbered_rows(text, mark))
    if named:
        keys = {key(one) for one in wanted if not BY_NUMBER.fullmatch(one)}
        texts = [k for k, (_, cells) in enumerate(rows) if any(cell[:1] not in DIGITS for cell in cells)]
        starts = [k for k in texts if keys <= set(_headers(rows[k][1], keys))]
    else:
        widest = max(int(one[1:]) for one in wanted)
        starts = [k for k, (_, cells) in enumerate(rows) if len(cells) >= widest and _numbers(cells) >= FEW][:1]
    return (rows, starts) if starts else None


def _headers(cells: Sequence[str], wanted: Iterable[str] = ()) -> list[str]:
    """Return the headers in a row; without comment characters unless a header in `wanted` has them."""
    found = list(map(key, cells))
    marked = found and found[0].startswith(COMMENTED) and not BY_NUMBER.fullmatch(found[0])
    if marked and found[0] not in set(map(key, wanted)):
        first = found[0].lstrip("".join(COMMENTED) + " ")
        found = [first, *found[1:]] if first else found[1:]
    return found


def _numbers(cells: Sequence[str]) -> int:
    return sum(map(is_numeral, cells))


def _fit(rows: Sequence[Row], starts: Sequence[int]) -> tuple[float, int]:
    """Return how well a separator fits: the fraction of rows as wide as the headers, and the number of headers."""
    width = len(_headers(rows[starts[0]][1]))
    below = rows[starts[0] + 1 :][:LOOK]
    alike = sum(len(cells) <= width or not any(cells[width:]) for _, cells in below if len(cells) >= width)
    return alike / max(len(below), 1), width


def _share(rows: Sequence[Row]) -> float:
    """Return the fraction of numbers in the cells of the first rows, by which a separator is chosen."""
    cells = [cell for _, row in rows[:LOOK] for cell in row if cell]
    return _numbers(cells) / len(cells)


def _last_row(rows: Sequence[Row], start: int, end: int) -> int:
    """Return the index of the last row of numbers below the headers `start`, up to the next headers `end`."""
    return next((k for k in range(end - 1, start, -1) if _numbers(rows[k][1]) >= FEW), start)


def _block(file: File, rows: Sequence[Row], start: int, wanted: Sequence[str]) -> LaboratoryTable:
    """Return the table in these rows, with headers in row `start`."""
    headers = _headers(rows[start][1], [one for one in wanted if not BY_NUMBER.fullmatch(one)])
    for one in wanted:
        numbers = [f"#{k}" for k, header in enumerate(headers, 1) if header == key(one)]
        if len(numbers) > 1:
            text = f"{file} has the header {one!r} above the columns {' and '.join(numbers)}"
            raise InputError(f"{text}: give the number of a column instead, e.g. {numbers[0]}")
    above = [" ".join(filter(None, cells)) for _, cells in rows[:start]]
    block = LaboratoryTable(rows[start][0], headers, above, [], {}, [])
    block.units.update({header: unit for header in headers if (unit := unit_in_header(header))})
    block.rows.extend(_without_empty(_below_units(rows[start + 1 :], block, wanted), block))
    return block


def _below_units(rows: Sequence[Row], block: LaboratoryTable, wanted: Sequence[str]) -> Sequence[Row]:
    """Return the rows below those of units and other text under the headers."""
    places = [block.place(one) for one in wanted]
    for number, (line, cells) in enumerate(rows[:MOST_UNITS]):
        used = [cells[k] for k in places if k < len(cells)]
        if any(is_numeral(cell) or MISSING.fullmatch(cell) for cell in used) or not any(cells):
            return rows[number:]
        units = {header: cell for header, cell in zip(block.headers, cells, strict=False) if is_unit(cell)}
        block.units.update(units)
        if not units:
            block.notes.append(f"line {line} below the headers is not read ({' '.join(cells)[:40]})")
    return rows[MOST_UNITS:]


def _without_empty(rows: Sequence[Row], block: LaboratoryTable) -> list[Row]:
    """Return the rows with any text; names the others that consist of separators."""
    empty = [line for line, cells in rows if not any(cells)]
    block.notes.extend([f"{lines_in_words(empty)}: empty"] if empty else [])
    return [row for row in rows if any(row[1])]


def lines_in_words(lines: Sequence[int]) -> str:
    """Return the numbers of lines in words; of many, the first ones."""
    few = 5
    some = ", ".join(map(str, lines[:few]))
    return f"{'line' if len(lines) == 1 else 'lines'} {some}{', ...' * (len(lines) > few)}"


def _without_headers(rows: Sequence[Row], start: int) -> LaboratoryTable:
    """Return the table of a file whose columns are given by their numbers."""
    width = max(len(cells) for _, cells in rows[start:])
    above = [" ".join(filter(None, cells)) for _, cells in rows[:start]]
    block = LaboratoryTable(0, [f"#{k}" for k in range(1, width + 1)], above, [], {}, [])
    block.notes.extend([f"{len(above)} lines above the first row of numbers are not read"] if above else [])
    block.rows.extend(_without_empty(rows[start:], block))
    return block


def _not_found(text: str, file: File, wanted: Sequence[str]) -> InputError:
    """Return the error for a file without these headers; it lists the headers that look most like them."""
    best: tuple[int, int, int, list[str]] = (0, 0, 0, [])
    for mark in _marks(text):
        for line, cells in itertools.islice(numbered_rows(text, mark), LOOK):
            named = [cell for cell in _headers(cells) if cell and not is_numeral(cell)]
            score = (sum(key(one) in named for one in wanted), len(named) if mark else len(named) > 1)
            if named and score > best[:2]:
                best = (*score, line, named)
    problem = f"{file} has no line with the headers {', '.join(wanted)}"
    by_number = "columns by their numbers, e.g. axial_strain=#1:%:compression"
    if not best[3]:
        return InputError(f"{problem}, nor any other headers: give {by_number}, or a file with a table")
    lacking = next(one for one in wanted if key(one) not in best[3])
    close = nearest(lacking, best[3])
    others = f"{close!r}, or another of {', '.join(best[3])}" if close else f"one of {', '.join(best[3])}"
    return InputError(f"{problem}: line {best[2]} has no {lacking!r}: give {others[:400]}; or {by_number}")


def _group(text: str, file: File, wanted: Sequence[str], group: str) -> LaboratoryTable:
    """Return a group of an AGS4 file."""
    rows = [(line, cells) for line, cells in numbered_rows(text, ",") if any(cells)]
    if any(cells[0].startswith("**") for _, cells in rows):
        raise InputError(f"{file} is an AGS 3 file: convert it to AGS 4, or export its table as CSV")
    starts = {cells[1]: k for k, (_, cells) in enumerate(rows) if cells[0] == "GROUP" and len(cells) > 1}
    if not starts:
        raise InputError(f"{file} is no AGS4 file, which has lines GROUP: leave out --ags4, or give another file")
    if group not in starts:
        raise InputError(f"{file} has no group {group}: give one of {', '.join(starts)}")
    labelled = collections.defaultdict(list)
    for line, cells in itertools.takewhile(lambda row: row[1][0] != "GROUP", rows[starts[group] + 1 :]):
        labelled[cells[0]].append((line, cells))
    if not (labelled["HEADING"] and labelled["DATA"]):
        raise InputError(f"the group {group} of {file} has no lines HEADING and DATA: give another group")
    line, headers = labelled["HEADING"][0]
    if lacking := next((one for one in wanted if one not in headers and not BY_NUMBER.fullmatch(one)), None):
        raise InputError(f"the group {group} of {file} has no {lacking}: give one of {', '.join(headers[1:])}")
    units = dict(zip(headers, labelled["UNIT"][0][1], strict=False)) if labelled["UNIT"] else {}
    return LaboratoryTable(
        line, headers, [], labelled["DATA"], {header: unit or "1" for header, unit in units.items()}, []
    )
