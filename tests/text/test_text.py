"""One reader of text: encodings, numbers, and tables below titles, headers and comments."""

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.text.reading import decimal_marks, numeral, read_table, real, split, text_of

ROWS = "x [\u00b5m];y;z;r\n1;2;3;4\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32", "cp1252"])
def test_encodings_give_the_same_text(tmp_path, encoding):
    file = tmp_path / "a.csv"
    file.write_bytes(ROWS.encode(encoding))
    assert text_of(file) == ROWS


@pytest.mark.parametrize(
    "content, message",
    [
        (b"PK\x03\x04xyz", "Excel workbook: save its table as CSV"),
        (b"\xfd7zXZ\0", "compressed with xz: unpack it first"),
        (b"BZh9", "compressed with bzip2"),
        (b"\x1f\x8b\x08\0abc", "gzip cannot unpack it"),
        (b"\0\1\2\3", "is not text"),
    ],
)
def test_other_files_are_named(tmp_path, content, message):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(InputError, match=message):
        text_of(tmp_path / "a.csv")


@pytest.mark.parametrize(
    "word, value",
    [("1.0D-03", 1e-3), ("-2.5d+02", -250.0), ("1.5-101", 1.5e-101), ("1Q2", 100.0), ("\u22123", -3.0), (" 4 ", 4.0)],
)
def test_numbers_of_fortran_and_of_spreadsheets(word, value):
    assert real(word) == value


@pytest.mark.parametrize(
    "word, commas, value",
    [
        ("1,234.5", False, 1234.5),
        ("1.234,5", True, 1234.5),
        ("1 234,5", True, 1234.5),
        ("1\u202f234\u202f567", False, 1234567.0),
        ("1'234.5", False, 1234.5),
        ("-1,234", False, -1234.0),
        ("1.234", True, 1234.0),
        ("0,05", True, 0.05),
        ("-5,5e3", True, -5500.0),
        ("1,0D-03", True, 1e-3),
    ],
)
def test_numbers_with_thousands_and_decimal_commas(word, commas, value):
    assert numeral(word, commas) == value


@pytest.mark.parametrize(
    "word, commas", [("1,23", False), ("1,2345", False), ("1,", True), ("1_000", True), ("", True)]
)
def test_other_cells_are_no_numbers(word, commas):
    with pytest.raises(ValueError, match="is not a number"):
        numeral(word, commas)


@pytest.mark.parametrize(
    "words, marks",
    [
        (["0.5", "1"], set()),
        (["0.5", "1"], set()),
        (["1,234", "1,300"], {"either ,"}),
        (["1,234,567"], {"."}),
        (["1.234,5", "1.234"], {",", "either ."}),
        (["sand", "-", "12", ""], set()),
    ],
)
def test_decimal_marks_are_those_that_the_numbers_show(words, marks):
    assert set(decimal_marks(words)) == marks


@pytest.mark.parametrize("word", ["1_000", "2026-11", "", "sand", "1,5"])
def test_other_words_are_no_numbers(word):
    with pytest.raises(ValueError, match="is not a number"):
        real(word)


TABLES = {
    "blanks": "x y z r\n1 2 3 4\n5 6 7 8\n",
    "commas, quotes": '"x","y","z","r"\n"1",2,3,4\n5, 6, 7, 8\n',
    "decimal commas": "x;y;z;r\n1,0;2,0;3,0;4,0\n5,0;6,0;7,0;8,0\n",
    "decimal commas, blanks": "x y z r\n1,0 2,0 3,0 4,0\n5,0 6,0 7,0 8,0\n",
    "tabs": "x\ty\tz\tr\n1\t2\t3\t4\n5\t6\t7\t8\n",
    "titles": "Sample A, 2 grains\nmeasured by hand\n\nx,y,z,r\n1,2,3,4\n5,6,7,8\n",
    "empty cells at the end": "x,y,z,r\n1,2,3,4,,\n5,6,7,8,,\n",
    "quotes, thousands": 'x,y,z,r\n1,2,3,"4.0"\n5,6,7,8\n',
    "comments": "# by hand\n% more\nx y z r # four\n1 2 3 4\n! and\n5 6 7 8 # last\n",
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_in_many_forms(name):
    table = read_table(TABLES[name], "t.csv")
    assert table.names == ["x", "y", "z", "r"]
    np.testing.assert_array_equal(table.numbers("t.csv"), [[1, 2, 3, 4], [5, 6, 7, 8]])
    assert table.commas == ("decimal" in name)
    assert any("points" in note for note in table.notes) == ("decimal" in name)
    assert table.titles == (2 if name == "titles" else 0)


def test_thousands_in_a_table_of_grains():
    table = read_table('x;y\n1,234.5;2\n3;"4,000"\n', "t.csv")
    np.testing.assert_array_equal(table.numbers("t.csv"), [[1234.5, 2], [3, 4000]])
    table = read_table("x;y\n0,5;1.234\n1;2\n", "t.csv")
    np.testing.assert_array_equal(table.numbers("t.csv"), [[0.5, 1234], [1, 2]])
    assert "1.234 is read as 1234" in "; ".join(table.notes)


def test_units_between_blanks_are_cells():
    assert read_table("x y r\n[mm] [mm] [mm]\n1 2 3\n4 5 6\n", "t.txt").names == ["x [mm]", "y [mm]", "r [mm]"]
    assert read_table("x [mm] y [mm] r [mm]\n1 2 3\n4 5 6\n", "t.txt").names == ["x[mm]", "y[mm]", "r[mm]"]


def test_a_row_of_units_belongs_to_the_names():
    table = read_table("x,y,z,r,id\nmm,mm,mm,um,-\n1,2,3,4,5\n", "t.csv")
    assert table.names == ["x [mm]", "y [mm]", "z [mm]", "r [um]", "id"]


def test_prose_is_no_table():
    with pytest.raises(InputError, match="has no rows of 2 or more numbers"):
        read_table("hello\nworld 1\n", "t.csv")


@pytest.mark.parametrize("line", ['"', ' " ', ""])
def test_a_line_of_nothing_but_a_quote_has_no_cells(line):
    assert split(line, ",") == []
