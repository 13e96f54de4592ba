"""Tables of laboratories in many forms: each gives the same numbers, or an error that names the line."""

import itertools

import numpy as np
import pytest

import labkit as lk
from labkit.plugins.laboratory_data.layout import Form
from labkit.plugins.laboratory_data.table import read_laboratory_columns
from labkit.plugins.laboratory_data.units import STRAIN_UNITS, STRESS_UNITS, unit_factor, unit_in_header

HEADERS = ["\u03b5\u2081", "\u03b5v", "\u03c3\u2081", "\u03c3\u2083"]
ROWS = [(0.0, 0.0, 100.25, 100.25), (0.5, 0.125, 180.5, 100.0), (1.0, -0.25, 1100.75, 99.5), (2.0, -0.5, 1234.0, 100.0)]
LATIN = ["Stauchung", "Volumen\u00e4nderung", "Axialdruck", "Zelldruck"]


def form(separator, comma, units, thousands="", headers=HEADERS, title=(), end=()):
    """Return a table of ROWS as text."""
    decimal = "," if comma else "."

    def cell(number):
        text = f"{number:,.3f}".replace(",", thousands).replace(".", "\0").replace("\0", decimal)
        if thousands == ".":
            text = f"{number:,.3f}".translate(str.maketrans(",.", ".,"))
        return f'"{text}"' if separator in text else text

    below = [separator.join(["[%]", "[%]", "[kPa]", "[kPa]"])] if units else []
    lines = [*title, separator.join(headers), *below, *(separator.join(map(cell, row)) for row in ROWS), *end]
    return "\n".join(lines) + "\n"


def columns_of(file, headers=HEADERS, **form):
    return read_laboratory_columns(file, dict.fromkeys(headers), Form(**form))


def require_rows(found, headers=HEADERS):
    """Check that every number was read."""
    values = np.array([found.values[one] for one in headers]).T
    np.testing.assert_allclose(values, ROWS, rtol=1e-12, atol=1e-12)


ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-32"]
FORMS = [
    (separator, comma, thousands)
    for separator, comma, thousands in itertools.product(
        [",", ";", "\t", " ", "|", "   "], [False, True], ["", ",", ".", "'", "\u00a0"]
    )
    if thousands != ("," if comma else ".") and not (separator in (" ", "   ") and thousands == "\u00a0")
]


@pytest.mark.parametrize("units", [False, True], ids=["", "units"])
@pytest.mark.parametrize(("separator", "comma", "thousands"), FORMS)
def test_separators_decimal_marks_and_thousands_give_the_same_numbers(tmp_path, separator, comma, thousands, units):
    file = tmp_path / "a.csv"
    file.write_text(form(separator, comma, units, thousands), encoding="utf-8")
    require_rows(found := columns_of(file))
    assert found.units == (dict(zip(HEADERS, ["[%]", "[%]", "[kPa]", "[kPa]"], strict=True)) if units else {})
    assert list(found.lines) == [2 + units, 3 + units, 4 + units, 5 + units]


def test_another_mark_between_thousands_can_be_given(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text(form(";", False, False, "_"), encoding="utf-8")
    require_rows(columns_of(file, thousands="_"))


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_encodings_and_ends_of_lines_give_the_same_numbers(tmp_path, separator, encoding, newline):
    file = tmp_path / "a.csv"
    text = form(separator, False, True, title=["Versuch 1", ""]).replace("\n", newline)
    file.write_bytes(text.encode(encoding))
    require_rows(columns_of(file))


@pytest.mark.parametrize(
    ("encoding", "headers"),
    [
        ("mac_roman", LATIN),
        ("utf-16-le", LATIN),
        ("shift_jis", ["\u8ef8\u3072\u305a\u307f", "\u4f53\u7a4d", "\u8ef8\u5fdc\u529b", "\u5074\u5727"]),
        ("cp1251", ["\u043e\u0441\u0435\u0432\u0430\u044f", "\u043e\u0431\u044a\u0451\u043c", "\u043d1", "\u043d3"]),
    ],
)
def test_another_encoding_is_given(tmp_path, encoding, headers):
    file = tmp_path / "a.csv"
    file.write_bytes(form(",", False, False, headers=headers).encode(encoding))
    with pytest.raises(lk.InputError, match=r"(or|or give) --encoding, e.g. (mac_roman|utf-16-le)"):
        columns_of(file, headers)
    require_rows(columns_of(file, headers, encoding=encoding), headers)
    with pytest.raises(lk.InputError, match="encoding klingon is unknown: give the name of an encoding"):
        columns_of(file, headers, encoding="klingon")


@pytest.mark.parametrize(
    "typed",
    ["Volumena\u0308nderung", "Volumen\u00e4nderung", " Volumen\u00e4nderung "],
    ids=["letters and marks", "letters", "blanks"],
)
def test_headers_that_look_the_same_are_the_same(tmp_path, typed):
    file = tmp_path / "a.csv"
    file.write_text(form(";", False, False, headers=LATIN), encoding="utf-8")
    wanted = [LATIN[0], typed, *LATIN[2:]]
    require_rows(columns_of(file, wanted), wanted)


QUOTED = ["Axial strain,\nLVDT (%)", 'q "corrected"', "sigma_1; total", "sigma_3\tcell"]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_headers_in_quotes_may_contain_separators_quotes_and_newlines(tmp_path, separator):
    file = tmp_path / "a.csv"
    headers = ['"' + one.replace('"', '""') + '"' for one in QUOTED]
    file.write_text(form(separator, False, False, headers=headers))
    require_rows(found := columns_of(file, QUOTED), QUOTED)
    assert list(found.lines) == [3, 4, 5, 6]  # the headers take two lines


def test_units_may_stand_in_cells_and_headers(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("eps (%);q kPa;p' [kN/m\u00b2];e\n0 %;0 kPa;100;0.8\n1,5 %;50 kPa;110;0,79\n")
    found = columns_of(file, ["eps (%)", "q kPa", "p' [kN/m\u00b2]"])
    assert list(found.values["eps (%)"]) == [0.0, 1.5] and list(found.values["q kPa"]) == [0.0, 50.0]
    assert [*found.units.values()] == ["%", "kPa", "kN/m\u00b2"] and [*found.texts] == ["e"]


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("sigma_1 [kPa]", "kPa"),
        ("sigma_1 (MPa)", "MPa"),
        ("q_kPa", "kPa"),
        ("q / kPa", "kPa"),
        ("q/kPa", "kPa"),
        ("q, kN/m\u00b2", "kN/m\u00b2"),
        ("Axial Strain (%)", "%"),
        ("strain {microstrain}", "microstrain"),
        ("Voids ratio (-)", "-"),
        ("Eff. Cambridge p' (kPa)", "kPa"),
        *((index, None) for index in ("stress(1)", "s (1)", "c_s[1]", "statev(1)", "E_1", "eps_1", "sigma_a")),
        ("eps [1]", "1"),
        ("test", None),
        ("Back Volume (mm\u00b3)", None),
    ],
)
def test_the_unit_in_a_header(header, unit):
    assert unit_in_header(header) == unit


@pytest.mark.parametrize(
    ("unit", "pascal"),
    [
        ("kN/m2", 1e3),
        ("kN/m\u00b2", 1e3),
        ("kN/m^2", 1e3),
        ("KPA", 1e3),
        ("N/mm2", 1e6),
        ("bar", 1e5),
        ("psi", 4.4482216152605 / 0.0254**2),
        ("psf", 4.4482216152605 / 0.3048**2),
        ("tsf", 2000 * 4.4482216152605 / 0.3048**2),
        ("kgf/cm\u00b2", 98066.5),
        ("furlong", None),
    ],
)
def test_units_of_stress(unit, pascal):
    found = unit_factor(unit, STRESS_UNITS)
    assert found == pascal if pascal is None else found == pytest.approx(pascal, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "share"), [("%", 0.01), ("-", 1.0), ("mm/mm", 1.0), ("\u2030", 1e-3), ("\u00b5\u03b5", 1e-6)]
)
def test_units_of_strain(unit, share):
    assert unit_factor(unit, STRAIN_UNITS) == share


def test_columns_by_number_need_no_headers(tmp_path):
    file = tmp_path / "a.csv"
    file.write_bytes(("\ufeff" + "\n".join(",".join(map(str, row)) for row in ROWS)).encode())
    wanted = ["#1", "#2", "#3", "#4"]
    require_rows(columns_of(file, wanted), wanted)
    file.write_text("Triaxial test 7\nby hand\n" + form("\t", True, False).partition("\n")[2])
    require_rows(found := columns_of(file, wanted), wanted)
    assert list(found.lines) == [3, 4, 5, 6] and "2 lines above" in found.notes[0]
    file.write_text(form(";", False, True))
    require_rows(found := columns_of(file, wanted), wanted)


def test_a_commented_header_is_a_header(tmp_path):
    file = tmp_path / "a.txt"
    for head in ("# e q", "#e q", "% e q", "// e q", "** e  q  ", "#\t\te\t\tq"):
        file.write_text(f"{head}\n0\t0\n1\t  10\t\n")
        assert list(columns_of(file, ["e", "q"]).values["q"]) == [0.0, 10.0]
    file.write_text("% strain,% volume\n0,0\n1,10\n")
    assert list(columns_of(file, ["% strain", "% volume"]).values["% volume"]) == [0.0, 10.0]


def test_empty_rows_comments_and_text_below_the_table_are_named(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("Sand\n\ne;q\nbrown;blue\n%;kPa\n0;0\n;\n# a pause\n1;10\n\nfailure of the membrane;\nend;\n")
    found = columns_of(file, ["e", "q"])
    assert list(found.values["e"]) == [0.0, 1.0] and found.units == {"e": "%", "q": "kPa"}
    said = "; ".join(found.notes)
    for words in ("line 4 below the headers", "line 7: empty", "line 8: comments", "lines 11, 12: below the table"):
        assert words in said


MISSING = ["n.a.", "N/A", "-", "", "NaN", "nan", "inf", "-inf", "#DIV/0!", "#N/A", "#WERT!", "null", "x", "?", "--"]


@pytest.mark.parametrize("place", [0, 1, 2], ids=["first", "middle", "last"])
@pytest.mark.parametrize("word", MISSING)
def test_rows_without_a_number_stop_the_reading_with_their_line(tmp_path, word, place):
    rows = ["0,100", "1,200", "2,250", "3,260"]
    rows.insert(place + 1, f"{place + 0.5},{word}")
    file = tmp_path / "a.csv"
    file.write_text("\n".join(["e,q", *rows]))
    with pytest.raises(lk.InputError, match=f"line {place + 3} has .*'q'.*--accept"):
        columns_of(file, ["e", "q"])
    found = columns_of(file, ["e", "q"], accept=True)
    assert list(found.values["e"]) == [0.0, 1.0, 2.0, 3.0]
    assert any(f"line {place + 3}: left out" in note for note in found.notes)


@pytest.mark.parametrize("number", ["-999", "-999.0", "9999", "-9999.00", "-999.25", "1e30", "-99", "99999"])
def test_numbers_that_stand_for_a_missing_value_stop_the_reading(tmp_path, number):
    file = tmp_path / "a.csv"
    file.write_text(f"e,q\n0,100\n1,{number}\n2,{number}\n3,120\n")
    with pytest.raises(lk.InputError, match=r"line 3 .*missing value.*line 4"):
        columns_of(file, ["e", "q"])
    assert list(columns_of(file, ["e", "q"], accept=True).values["q"]) == [100.0, 120.0]


def test_a_measured_9999_between_similar_numbers_is_kept(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("e,q\n0,9900\n1,9999\n2,10100\n")
    assert list(columns_of(file, ["e", "q"]).values["q"]) == [9900.0, 9999.0, 10100.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        ("e,q\n", "no rows below the headers in line 1"),
        ("e,q\n%,kPa\n", "no rows below the headers in line 1"),
        ("e,p\n1,2\n", "line 1 has no 'q': give .*e, p"),
        ("1,2\n3,4\n", "nor any other headers: give columns by their numbers"),
        ("e,q\n1,0,5\n2,1,6\n", "line 2 has 3 cells for 2 headers .*: add a header for every column"),
        ("only text\n", "line 1 has no 'e'|nor any other headers"),
        ('<?xml version="1.0"?>\n<Diggs>\n</Diggs>\n', "is XML, HTML or JSON: export the table"),
        ("<html>\n</html>\n", "is XML, HTML or JSON"),
        ("e,q\n0,0\n1,2,3\n", "line 3 has 3 cells for 2 headers: put numbers with commas in quotes"),
        ("e,q\n0,500,12,3\n1,000,15,1\n", "line 2 has 4 cells for 2 headers .*and line 3"),
        ("e,q\n0\n1,2\n", "line 2 has nothing in 'q'"),
        ("e;q\n0,5;1\n0.6;2\n", "0,5 in line 2 has a decimal comma, and 0.6 in line 3 has a decimal point"),
        ("e;q\n0;1,234\n1;1,300\n", "1,234 in line 2 may be 1.234 or 1234: give --decimal"),
        ('e,q\n0,"1\n' + "1,2\n" * 30, "line 2 opens a quote that is not closed"),
        ("e,q,q\n0,1,2\n", "header 'q' above the columns #2 and #3"),
        ("e v q\n0 0 0\n1 10\n2 1 20\n", "line 3 has 2 cells for 3 headers"),
        ("e q x = y\n0 0 1\n1 10 2\n", "line 2 has 3 cells for 5 headers"),
    ],
)
def test_what_cannot_be_read_says_why(tmp_path, text, message):
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(lk.InputError, match=message):
        columns_of(file, ["e", "q"])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"PK\x03\x04" + bytes(50), "Excel workbook: save its table as CSV"),
        (b"\xd0\xcf\x11\xe0" + bytes(50), "Excel workbook: save its table as CSV"),
        (b"e,q\n0,1\0\n", "is not text"),
        (bytes(100), "is not text"),
        (b"%PDF-1.7\n\x00\x01", "is not text"),
    ],
)
def test_other_files_are_named(tmp_path, content, message):
    file = tmp_path / "a.csv"
    file.write_bytes(content)
    with pytest.raises(lk.InputError, match=message):
        columns_of(file, ["e", "q"])


def test_the_decimal_mark_can_be_given(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("e;q\n0;1,234\n1;1,300\n")
    assert list(columns_of(file, ["e", "q"], decimal="comma").values["q"]) == [1.234, 1.3]
    assert list(columns_of(file, ["e", "q"], decimal="point").values["q"]) == [1234.0, 1300.0]
    file.write_text("e;q\n0;1.234\n0,5;1.300,5\n")
    found = columns_of(file, ["e", "q"])
    assert list(found.values["q"]) == [1234.0, 1300.5] and "1.234 in line 2 is read as 1234" in "; ".join(found.notes)


BLOCKS = "Test A\ne,q\n0,0\n1,10\n\nTest B\ne,q\n%,kPa\n0,0\n2,20\nremark,\n"


def test_tables_below_each_other_are_chosen_by_the_line_of_their_headers(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text(BLOCKS)
    said = r"these headers in the lines 2 \(below 'Test A'\) and 7 \(below 'Test B'\): give --header"
    with pytest.raises(lk.InputError, match=said):
        columns_of(file, ["e", "q"])
    assert list(columns_of(file, ["e", "q"], header=2).values["q"]) == [0.0, 10.0]
    assert list(columns_of(file, ["e", "q"], header=7).values["q"]) == [0.0, 20.0]
    assert list(columns_of(file, ["e", "q"], accept=True).lines) == [3, 4, 9, 10]
    with pytest.raises(lk.InputError, match="no line 3 with the headers e, q"):
        columns_of(file, ["e", "q"], header=3)


def test_rows_of_one_test_are_chosen_by_a_column(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("hole;sample;e;q\nBH1;1;0;0\nBH1;1.0;1;10\nBH2;2;0;0\n")
    found = columns_of(file, ["e", "q"], rows={"hole": "BH1", "sample": "1"})
    assert list(found.values["q"]) == [0.0, 10.0] and "1 rows have another hole" in "; ".join(found.notes)
    with pytest.raises(lk.InputError, match="no rows with hole=BH3: give a value of the column, BH1, BH2"):
        columns_of(file, ["e", "q"], rows={"hole": "BH3"})


AGS = """"GROUP","CTRD"\r
"HEADING","LOCA_ID","CTRD_EAS","CTRD_DEV"\r
"UNIT","","%","kN/m2"\r
"TYPE","ID","2DP","1DP"\r
"DATA","BH1","0.00","0.0"\r
"DATA","BH1","0.50","1,030.5"\r
"DATA","BH2","0.00",""\r
\r
"GROUP","TRET"\r
"HEADING","LOCA_ID"\r
"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_groups_of_ags4(tmp_path, encoding):
    file, wanted = tmp_path / "a.ags", ["CTRD_EAS", "CTRD_DEV"]
    file.write_bytes(AGS.encode(encoding))
    found = columns_of(file, wanted, group="CTRD", rows={"LOCA_ID": "BH1"})
    assert list(found.values["CTRD_DEV"]) == [0.0, 1030.5] and found.units == {"CTRD_EAS": "%", "CTRD_DEV": "kN/m2"}
    assert list(found.lines) == [5, 6]
    with pytest.raises(lk.InputError, match="line 7 has nothing in 'CTRD_DEV'"):
        columns_of(file, wanted, group="CTRD")
    with pytest.raises(lk.InputError, match="no group TRIX: give one of CTRD, TRET"):
        columns_of(file, wanted, group="TRIX")
    with pytest.raises(lk.InputError, match="1 lines HEADING and 0 lines DATA"):
        columns_of(file, ["LOCA_ID"], group="TRET")
    file.write_text('"**PROJ"\n"*PROJ_ID","*PROJ_NAME"\n"1","a"\n')
    with pytest.raises(lk.InputError, match="AGS 3"):
        columns_of(file, wanted, group="CTRD")
    file.write_text("a,b\n1,2\n")
    with pytest.raises(lk.InputError, match="no AGS4 file"):
        columns_of(file, wanted, group="CTRD")
