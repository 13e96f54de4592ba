"""The report of real results in a real Chromium without a network: on a screen, on a phone, on paper."""

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pandas
import pytest

import labkit
from analysis.markdown import number
from analysis.paper import runs
from analysis.paper.condense import condense
from analysis.paper.report import CAPTIONS, report
from analysis.paper.report_numbers import STOCK, bench_speeds, costs, idle_hours
from analysis.paper.study import cost_table
from labkit.errors import InputError
from labkit.process import install_command

pytestmark = pytest.mark.long

RESULTS = Path(labkit.__file__).parents[1] / "results"
PHONE, DESKTOP = {"width": 390, "height": 844}, {"width": 1280, "height": 900}
NASTY = "a | b *c* `d` <script>alert(1)</script> $e$ [f](g) ^h^ _i_ \\j & &amp; {.k}"


@pytest.fixture(scope="module")
def results(tmp_path_factory, run_file):
    """A results folder with a run of the small specimen and pictures and tables of the repository."""
    results = tmp_path_factory.mktemp("results")
    shutil.copytree(RESULTS / "hard_cases", results / "hard_cases")
    (results / "speed_error").mkdir()
    for name in ("engines.csv", "settings.csv", "study.nc"):
        shutil.copy(RESULTS / "speed_error" / name, results / "speed_error" / name)
    paper = results / "paper"
    (paper / "runs").mkdir(parents=True)
    condense(run_file, paper / "runs/cv-small.run.nc", "./lab paper")
    shutil.copy(RESULTS / "critical.png", paper / "fig1.png")
    shutil.copy(RESULTS / "micro/budget.png", paper / "strength_shares.png")
    shutil.copy(RESULTS / "micro/groups.png", paper / "not_in_captions.png")
    ends = pandas.read_csv(RESULTS / "critical.csv")
    ends.to_csv(paper / "critical_states.csv", index=False)
    shutil.copy(RESULTS / "model_calibration.csv", paper / "parameters.csv")
    for name in ("sff.csv", "model_errors.csv", "engines.csv"):
        shutil.copy(RESULTS / "paper" / name, paper / name)
    fidelity = pandas.DataFrame(
        {
            "number": ends["run"],
            "label": "M of " + ends["run"],
            "ours": ends["M"],
            "within": ends["M_scatter"],
            "paper_says": "0.92",
            "paper_rounding": 0.005,
            "difference": ends["M"] - 0.92,
            "uncertainty_of": "scatter of 5 tests",
            "tests": 5,
            "kind": "measured",
            "agrees": np.where(abs(ends["M"] - 0.92) <= ends["M_scatter"] + 0.005, "yes", "no"),
            "explanation": NASTY,
        }
    )
    alike = {
        "number": "e0",
        "label": "e0 of one specimen",
        "ours": 0.7249,
        "within": 0.0,
        "tests": 2,
        "agrees": "no",
        "kind": "measured",
    }
    alike |= {"paper_says": "0.724", "paper_rounding": 0.0005, "difference": 0.0009}
    single = {
        **alike,
        "label": "e0 of one test",
        "within": np.nan,
        "tests": 1,
        "uncertainty_of": "one test: no interval",
    }
    fidelity = pandas.concat([fidelity, pandas.DataFrame([alike, single])])
    fidelity.to_csv(paper / "fidelity.csv", index=False)
    cost_table(runs(paper)).to_csv(paper / "campaign.csv", index=False)
    return paper


@pytest.fixture(scope="module")
def file(results, study_command):
    done = study_command("report", results, "-o", results / "report.html")
    assert done.returncode == 0, done.stderr
    return results / "report.html"


@pytest.fixture(scope="module")
def opened(browser, file):
    """(page on a phone without a network, messages of its console and its requests)."""
    page, log = browser(viewport=PHONE, offline=True), []
    page.on("console", lambda message: log.append(message.text))
    page.on("pageerror", lambda error: log.append(str(error)))
    page.on("requestfailed", lambda request: log.append(f"failed: {request.url[:100]}"))
    page.on("request", lambda request: log.append(request.url))
    page.goto(file.as_uri())
    page.wait_for_load_state("networkidle")
    return page, log


@pytest.fixture(scope="module")
def wide(browser, file):
    """The page on a desktop."""
    page = browser(viewport=DESKTOP, offline=True, reduced_motion="reduce")
    page.goto(file.as_uri())
    page.wait_for_load_state("networkidle")
    return page


def test_only_the_page_and_its_pictures_are_read_and_there_are_no_errors(opened, file):
    place = file.parents[1].as_uri()
    pictures = ("paper/fig1", "paper/strength_shares", "paper/not_in_captions", "hard_cases/hard_cases")
    assert set(opened[1]) == {file.as_uri(), *(f"{place}/{picture}.png" for picture in pictures)}
    assert file.stat().st_size < 1e6


def test_all_pictures_are_shown(opened):
    pictures = opened[0].evaluate("[...document.images].map(i => [i.alt, i.complete, i.naturalWidth])")
    captions = [CAPTIONS["caption"].get(name) for name in ("fig1.png", "strength_shares.png")]
    captions += ["not in captions", CAPTIONS["caption"]["../hard_cases/hard_cases.png"]]
    assert sorted(alt for alt, *_ in pictures) == sorted(captions)
    assert all(complete and width > 0 for _, complete, width in pictures)


def test_every_link_inside_the_page_has_a_unique_target(opened):
    links = opened[0].evaluate("[...document.querySelectorAll('a[href^=\"#\"]')].map(a => a.getAttribute('href'))")
    ids = opened[0].evaluate("[...document.querySelectorAll('[id]')].map(e => e.id)")
    assert len(ids) == len(set(ids))
    assert {link[1:] for link in links} <= set(ids)
    assert "#picture-fig1" in links and "#provenance" in links


def test_the_contents_fold_on_a_phone_and_stay_at_its_top(opened):
    page = opened[0]
    page.click("nav summary")
    page.click("nav a[href='#hard-cases']")
    page.wait_for_function("Math.abs(document.getElementById('hard-cases').getBoundingClientRect().top) < 200")
    nav = page.evaluate(
        "(n => ({top: n.top, height: n.height}))(document.querySelector('nav').getBoundingClientRect())"
    )
    assert nav["top"] == 0 and nav["height"] < 60  # visible, and folded again
    assert page.evaluate("document.getElementById('hard-cases').getBoundingClientRect().top") >= nav["height"] - 1


def test_the_contents_stay_beside_the_page_on_a_desktop(wide):
    for place in ("summary", "love", "provenance"):
        wide.evaluate("p => document.getElementById(p).scrollIntoView({behavior: 'instant'})", place)
        box = wide.evaluate("(n => [n.top, n.bottom, n.right])(document.querySelector('nav').getBoundingClientRect())")
        assert 0 <= box[0] and box[1] <= DESKTOP["height"] and wide.is_visible("nav a[href='#cost']")
        assert box[2] < wide.evaluate("document.querySelector('h2').getBoundingClientRect().left")


def test_the_summary_comes_first_and_states_the_results_with_links(opened, results):
    page = opened[0]
    assert page.evaluate("document.querySelector('h2').id") == "summary"
    items = page.evaluate("""[...document.querySelector('#summary').nextElementSibling.children]
        .map(i => [i.innerText, [...i.querySelectorAll('a')].map(a => a.getAttribute('href'))])""")
    links = {link for _, targets in items for link in targets}
    assert links == {"#run-names", "#numbers", "#love", "#model", "#engines", "#hard-cases", "#cost"}
    text = "\n".join(text for text, _ in items)
    sff = pandas.read_csv(results / "sff.csv")
    shear = sff[sff["path"].isin(["cv", "cr", "cp"]) & ~sff["run"].str.startswith(("share_", "full_"))]
    assert f"{len(shear)} monotonic shear tests" in text and f"at most {100 * shear['worst'].max():.1f} %" in text
    verdicts = pandas.read_csv(results / "fidelity.csv")["agrees"].value_counts()
    assert f"{verdicts['yes']} agree with the paper, {verdicts['no']} do not" in text
    assert "e0 of one specimen: ours 0.7249, paper 0.724" in text


def test_run_names_and_verdicts_are_explained(opened):
    text = opened[0].evaluate("document.body.innerText")
    for part in ("cv_other", "_more-s2", "cp_start", "-paper"):
        assert f"\n{part}" in text or f" {part}" in text, part
    assert "the half-width of the interval plus the rounding" in text
    assert "Only measured numbers count: input was put into the simulations" in text


def test_on_a_phone_tables_scroll_in_their_boxes_and_the_page_does_not(opened):
    page = opened[0]
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    beyond = page.evaluate("""[...document.querySelectorAll('h1, h2, p, img, pre, nav, summary, .table')]
        .filter(e => e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML)""")
    assert beyond == []
    boxes = page.evaluate("""[...document.querySelectorAll('.table')].filter(b => b.scrollWidth > b.clientWidth)
        .map(b => getComputedStyle(b).overflowX)""")
    assert boxes and set(boxes) == {"auto"}


def test_a_box_that_scrolls_has_a_hint_and_no_cell_is_cut(opened, wide):
    for page in (opened[0], wide):
        boxes = page.evaluate("""[...document.querySelectorAll('.table')].filter(b => b.checkVisibility()).map(b =>
            [b.scrollWidth > b.clientWidth + 1, parseFloat(getComputedStyle(b, '::before').height)])""")
        assert {scrolls for scrolls, _ in boxes} == {True, False}
        assert all((height > 10) == scrolls for scrolls, height in boxes)
        cut = page.evaluate("""[...document.querySelectorAll('td, td *')].filter(c => c.checkVisibility())
            .filter(c => c.scrollHeight > c.clientHeight + 2 && getComputedStyle(c).overflowY != 'visible').length""")
        assert cut == 0


def test_text_in_figures_is_readable_on_a_wide_page(browser, file):
    page = browser(viewport={"width": 1000, "height": 800})
    page.goto(file.as_uri())
    page.wait_for_load_state("networkidle")
    widths = page.evaluate("""[...document.images].map(i =>
        [i.getBoundingClientRect().width, parseFloat(getComputedStyle(i).getPropertyValue('--least'))])""")
    assert all(width >= least > 400 for width, least in widths)  # text of 8 points in the figure has at least 9 pixels


def test_the_tables_show_the_data_and_no_markup_in_it(opened, results):
    rows = opened[0].evaluate("[...document.querySelectorAll('tr')].map(r => [...r.cells].map(c => c.innerText))")
    for row in pandas.read_csv(results / "fidelity.csv").itertuples():
        header = next(cells for cells in rows if "our interval (95 %)" in cells)
        shown = dict(zip(header, next(cells for cells in rows if cells[0] == row.label), strict=True))
        assert float(shown["ours"]) == pytest.approx(row.ours, rel=1e-2) and shown["agrees"] == row.agrees
        if row.within > 0.0:
            allowed = row.within + row.paper_rounding
            assert float(shown["our interval (95 %)"].removeprefix("± ")) == pytest.approx(row.within, rel=0.05)
            assert float(shown["allowed"]) == pytest.approx(allowed, rel=0.05)
            assert (abs(row.difference) <= allowed) == (row.agrees == "yes")
            assert [row.label, NASTY] in rows
        else:  # two tests of the same specimen; a single test
            assert shown["our interval (95 %)"] == ("exact" if row.within == 0.0 else "unknown")
            assert shown["allowed"] == "0.0005"


def test_rows_are_coloured_by_agreement(opened):
    colours = opened[0].evaluate("""[...document.querySelectorAll('tr')]
        .filter(r => r.cells.length > 8 && ['yes', 'no'].includes(r.cells[8].innerText))
        .map(r => [r.cells[8].innerText, getComputedStyle(r.cells[1]).backgroundColor])""")
    assert {verdict for verdict, _ in colours} == {"yes", "no"}
    assert len(set(map(tuple, colours))) == 2


def test_dark_if_the_reader_prefers_it(browser, file):
    page = browser(viewport=PHONE, color_scheme="dark")
    page.goto(file.as_uri())
    of = "(name) => getComputedStyle(document.body)[name].match(/\\d+/g).slice(0, 3).reduce((a, b) => a + +b, 0)"
    assert page.evaluate(of, "color") > 600 > 200 > page.evaluate(of, "backgroundColor")


def test_prints_with_open_tables_and_uncut_figures(browser, file):
    page = browser(viewport={"width": 690, "height": 1000})  # about the width of A4 less margins
    page.goto(file.as_uri())
    page.emulate_media(media="print")
    heights = page.evaluate("[...document.querySelectorAll('details td')].map(c => c.getBoundingClientRect().height)")
    assert heights and min(heights) > 0
    assert set(page.evaluate("[...document.querySelectorAll('figure')].map(f => getComputedStyle(f).breakInside)")) == {
        "avoid"
    }
    pdf = page.pdf(prefer_css_page_size=True)
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 20


def test_its_provenance_is_written_next_to_it(file, results, labkit_command):
    done = labkit_command("info", file, "--check")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "input fidelity.csv" in done.stdout and "./lab report" in done.stdout


def test_costs_follow_from_the_data(results):
    runs, bench = pandas.read_csv(results / "campaign.csv"), results.parent / "speed_error/engines.csv"
    lines = [line.split(",") for line in bench.read_text().splitlines() if f'"{STOCK.split(",")[0]}' in line]
    stock = float(max(lines, key=lambda cells: int(cells[0]))[4])
    speeds = bench_speeds(pandas.read_csv(bench))
    assert speeds[STOCK] == stock
    total = costs(runs.assign(threads=2), stock).iloc[-1]
    steps = (runs["steps"] * runs["grains"]).sum()
    assert total["core time, h"] == pytest.approx(2 * runs["wall_time"].sum() / 3600)
    assert total["wall time, h"] == pytest.approx(runs["wall_time"].sum() / 3600)
    assert total["stock YADE, h"] == pytest.approx(steps / stock / 3600)
    fused = runs.assign(engine="fused")
    assert idle_hours(fused, speeds) == pytest.approx(steps / speeds["fused, 1 thread"] / 3600)
    assert idle_hours(fused.assign(engine="other"), speeds) is None and idle_hours(fused, {}) is None


def test_missing_files_are_named_with_their_commands(tmp_path):
    report(tmp_path, tmp_path / "report.html", "./lab report")
    text = (tmp_path / "report.html").read_text()
    missing = re.findall(r"Missing: (.*?)\.\s+Written\s+by\s+<code>(.*?)</code>", text, re.DOTALL)
    found = {name: command for names, command in missing for name in names.split(", ")}
    assert found["fidelity.csv"] == "./lab paper" and found["fig10.png"] == "./lab paper"
    assert found["pareto_cp.png"] == "./lab speed-error" and found["hard_cases.csv"] == "./lab hard-cases"
    assert 'id="summary"' not in text


def test_a_page_in_another_folder_links_to_the_pictures(results, tmp_path):
    report(results, tmp_path / "report.html", "./lab report")
    pictures = re.findall(r'<img src="([^"]*)"', (tmp_path / "report.html").read_text())
    assert len(pictures) == 4 and all((tmp_path / picture).is_file() for picture in pictures)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (14331.0, "14331"),
        (0.90593, "0.9059"),
        (0.92, "0.92"),
        (-1.5e-16, "-1.5 x 10^-16^"),
        (1.2e11, "1.2 x 10^11^"),
        (0.0, "0"),
        (float("nan"), ""),
        (99996.0, "99996"),
        (1e-3, "0.001"),
        (1e6, "1000000"),
    ],
)
def test_numbers_are_as_long_as_they_need(value, text):
    plain = {"\N{NO-BREAK SPACE}": " ", "\N{MINUS SIGN}": "-", "\N{MULTIPLICATION SIGN}": "x"}
    assert number(value).translate(str.maketrans(plain)) == text


def test_a_missing_folder_or_pandoc_is_reported(tmp_path, monkeypatch, study_command):
    done = study_command("report", tmp_path / "none")
    assert done.returncode == 2 and "./lab paper" in done.stderr
    monkeypatch.setitem(os.sys.modules, "pypandoc", None)  # as if it were not installed
    with pytest.raises(InputError, match=re.escape(install_command("report"))):
        report(tmp_path, tmp_path / "report.html", "./lab report")
    assert not (tmp_path / "report.html").exists()
