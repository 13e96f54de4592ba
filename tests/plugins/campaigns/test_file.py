"""Valid campaign files, and many invalid ones: every error with its line, nothing started."""

import dataclasses

import pytest

from labkit.errors import InputError
from labkit.paths.rates import default_rate
from labkit.paths.standard import ConstantVolume
from labkit.plugins.campaigns.file import read_campaign
from labkit.specimens.recipe import SETTINGS

GOOD = """\
settings: quick
engine: fused
specimens:
  dense: {void_ratio: 0.606, step1_friction: 0.05, grains: 150, seed: [1, 2]}
  loose: {void_ratio: 0.72, side: 1 mm, time_step_factor: 0.2}
  dense_1MPa: {from: dense, pressure: 1 MPa}
runs:
  cv: {path: cv, specimen: loose, strain: 0.05, rate: 20 1/s, snapshots: 3}
  cp: {path: cp, specimen: [dense, loose], pressure: [500 kPa, 1 MPa], engine: [yade, fused]}
  cyclic: {path: cyclic_cp, specimen: dense_1MPa, reversals: [0.01, -0.01]}
"""

MANY = "void_ratio", "friction", "diameter_spread", "local_damping", "step1_friction"
HEAD = "engine: fused\nspecimens:\n  a: {void_ratio: 0.67, grains: 150}\n"
RUNS = "runs:\n  cv: {path: cv, specimen: a}\n"


def specimen(fields):
    return f"engine: fused\nspecimens:\n  a: {{{fields}}}\n{RUNS}"


def run(fields):
    return f"{HEAD}runs:\n  r: {{{fields}}}\n"


# name -> (text, [(line, message)]): every error that must be reported, and no other
BROKEN = {
    "empty": ("", [(1, "holds `specimens:`")]),
    "a list": ("- a\n- b\n", [(1, "`specimens:`")]),
    "not YAML": ("specimens: {a: [\nruns: 3\n", [(3, "not YAML")]),
    "a character that may not be": ("specimens: \x00\n", [(1, "YAML")]),
    "nested without end": ("[" * 5000, [(1, "nested too deep")]),
    "no runs": (HEAD, [(1, "`runs:` is missing")]),
    "no specimens": (RUNS, [(1, "`specimens:`"), (2, "'a'")]),
    "empty runs": (HEAD + "runs: {}\n", [(4, "`runs:` is empty")]),
    "runs without a value": (HEAD + "runs:\n", [(4, "`runs:`")]),
    "runs as a list": (HEAD + "runs: [cv]\n", [(4, "is a list")]),
    "unknown key of the file": (HEAD + RUNS + "colour: red\n", [(6, "'colour' is unknown")]),
    "misspelt key of the file": (HEAD + RUNS + "setings: quick\n", [(6, "did you mean 'settings'")]),
    "unknown settings": ("settings: fast\n" + HEAD + RUNS, [(1, "settings 'fast'")]),
    "unknown engine": (HEAD.replace("fused", "warp") + RUNS, [(1, "engine 'warp'")]),
    "a name that is a path": ("name: ../up\n" + HEAD + RUNS, [(1, "cannot be the name of a folder")]),
    "pairs with mistakes": (
        """specimens:
  a:
    pairs:
      - {void_ratio: 0.62, step1_fricton: 0.05}
      - {void_ratio: 0.7, grains: 150}
      - {void_ratio: [0.6, 0.7]}
    grains: 200
  b: {void_ratio: 0.67, pairs: {seed: 3}}
  c: {pairs: [{void_ratio: 0.6}, {void_ratio: 0.6}]}
"""
        + RUNS,
        [
            (4, "did you mean 'step1_friction'"),
            (5, "grains is also given outside of pairs"),
            (6, "void_ratio is a list"),
            (8, "pairs is a mapping"),
            (9, "the same values twice"),
        ],
    ),
    "void ratio missing": (specimen("grains: 150"), [(3, "void_ratio is missing")]),
    "void ratio a word": (specimen("void_ratio: dense, grains: 150"), [(3, "void_ratio 'dense' ")]),
    "the same value twice": (
        specimen("void_ratio: [0.6, 60 %], grains: 150, seed: [1, 1]"),
        [(3, "void_ratio lists the same value twice"), (3, "seed ")],
    ),
    "too many lists": (
        specimen(", ".join(f"{name}: [0.{', 0.'.join(map(str, range(30, 40)))}]" for name in MANY) + ", grains: 150"),
        [(3, "more than 10000 combinations")],
    ),
    "a list of paths": (run("path: [cv, cp], specimen: a"), [(5, "path is a list")]),
    "a parameter that the law does not use": (
        specimen("void_ratio: 0.67, grains: 150, law: hertz_mindlin, rolling_friction: [0.2, 0.3]"),
        [(3, "rolling_friction 0.2 "), (3, "rolling_friction 0.3 ")],
    ),
    "a parameter that the law of a run does not use": (run("path: cv, specimen: a, beta_n: 0.3"), [(5, "beta_n 0.3 ")]),
    "void ratio empty": (specimen("void_ratio: , grains: 150"), [(3, "void_ratio is empty")]),
    "a side without a unit": (specimen("void_ratio: 0.67, side: 4"), [(3, "4 mm, or 4 m ")]),
    "a side that holds nothing": (specimen("void_ratio: 0.67, side: 0.1 mm"), [(3, "side 0.0001 ")]),
    "side and grains": (specimen("void_ratio: 0.67, side: 1 mm, grains: 150"), [(3, "side 0.001 ")]),
    "no seeds": (specimen("void_ratio: 0.67, grains: 150, seed: []"), [(3, "empty list")]),
    "unknown key of a specimen": (specimen("void_ratio: 0.67, frction: 1"), [(3, "'frction'")]),
    "law spring_dashpot on yade": (
        specimen("void_ratio: 0.67, grains: 150, law: spring_dashpot, engine: yade"),
        [(3, "spring_dashpot")],
    ),
    "a specimen that is a number": (
        HEAD + "  b: 3\n" + RUNS,
        [(4, "specimen b is a single value"), (4, "void_ratio ")],
    ),
    "the same specimen twice": (
        HEAD + "  a: {void_ratio: 0.7}\n" + RUNS,
        [(4, "'a' is defined twice, first in line 3")],
    ),
    "the same run twice": (HEAD + RUNS + "  cv: {path: cr, specimen: a}\n", [(6, "line 5")]),
    "names that differ by case": (
        HEAD + "  A: {void_ratio: 0.7}\n" + RUNS,
        [(4, "A is a on file systems that ignore")],
    ),
    "runs that differ by case": (HEAD + RUNS + "  CV: {path: cr, specimen: a}\n", [(6, "CV is cv on file systems")]),
    "names that come out the same": (
        HEAD + "  b: {void_ratio: 0.67, grains: 150}\nruns:\n  cv: {path: cv, specimen: "
        "[a, b]}\n  cv-a: {path: cv, specimen: a}\n",
        [(7, "run cv-a ")],
    ),
    "a name with a slash": (HEAD + "  a/b: {void_ratio: 0.7}\n" + RUNS, [(4, "cannot be the name of a file")]),
    "derived from itself": (HEAD + "  b: {from: b, pressure: 1 MPa}\n" + RUNS, [(4, "(b from b)")]),
    "a cycle of three": (
        HEAD + "  b: {from: d, pressure: 1 MPa}\n  c: {from: b, pressure: 1 MPa}\n"
        "  d: {from: c, pressure: 1 MPa}\n" + RUNS,
        [(4, "b from d from c from b")],
    ),
    "a run on a cycle": (
        HEAD + "  b: {from: b, pressure: 1 MPa}\nruns:\n  r: {path: cv, specimen: b}\n",
        [(4, "(b from b)")],
    ),
    "derived from an unknown specimen": (HEAD + "  b: {from: aa, pressure: 1 MPa}\n" + RUNS, [(4, "'aa'")]),
    "consolidated to no pressure": (HEAD + "  b: {from: a}\n" + RUNS, [(4, "pressure ")]),
    "consolidated too far": (HEAD + "  b: {from: a, pressure: 5 MPa}\n" + RUNS, [(4, "5e+06 Pa")]),
    "consolidated with a void ratio": (
        HEAD + "  b: {from: a, pressure: 1 MPa, void_ratio: 0.6}\n" + RUNS,
        [(4, "'void_ratio'")],
    ),
    "path missing": (run("specimen: a"), [(5, "path ")]),
    "path unknown": (run("path: cx, specimen: a"), [(5, "path 'cx'")]),
    "specimen missing": (run("path: cv"), [(5, "specimen ")]),
    "specimen unknown": (run("path: cv, specimen: dense"), [(5, "'dense'")]),
    "pressure without a unit": (run("path: cp, specimen: a, pressure: 0.5"), [(5, "0.5 MPa or kPa, or 0.5 Pa ")]),
    "parameters that cv does not have": (
        run("path: cv, specimen: a, pressure: 1 MPa, reversals: [0.01]"),
        [(5, "pressure is not a parameter of cv"), (5, "reversals ")],
    ),
    "one pressure of two": (run("path: cp, specimen: a, pressure: [1 MPa, 9 MPa]"), [(5, "9e+06 Pa")]),
    "rate too slow": (run("path: cv, specimen: a, rate: 1e-9 1/s"), [(5, "steps for the shortest step")]),
    "reversals that do not alternate": (
        run("path: cyclic_cp, specimen: a, reversals: [0.01, 0.02]"),
        [(5, "does not reverse")],
    ),
    "time step of all": ("time_step_factor: -1\n" + specimen("void_ratio: 0.67"), [(1, "time_step_factor -1 ")]),
    "a consolidation on yade of a specimen with law spring_dashpot": (
        specimen("void_ratio: 0.67, grains: 150, law: spring_dashpot").replace(
            "cv,", "cp, pressure: 500 kPa, law: rolling_resistance, engine: yade,"
        ),
        [(5, "its consolidation: engine yade")],
    ),
    "a name that labkit reserves": (
        (HEAD + "  a-at-p500kPa-fused: {void_ratio: 0.67, grains: 150}\n" + RUNS),
        [(4, "labkit reserves this name")],
    ),
    "law spring_dashpot in a run on yade": (
        run("path: cv, specimen: a, law: spring_dashpot, engine: yade"),
        [(5, "spring_dashpot")],
    ),
    "five at once": (
        "settings: fast\n" + specimen("void_ratio: 9, grains: 0, seed: -1") + "  r: {path: cx, specimen: a}\n",
        [(1, "'fast'"), (4, "void_ratio 9"), (4, "grains 0"), (4, "seed -1"), (7, "'cx'")],
    ),
    "grains of another size in a run": (run("path: cv, specimen: a, mean_diameter: 1 mm"), [(5, "'mean_diameter'")]),
    "softer grains in a run": (
        run("path: cp, specimen: a, pressure: 1 MPa, young_modulus: 10 MPa"),
        [(5, "E = 1e+07 Pa")],
    ),
    "a file to use that is not there": (
        "use: [own.py]\n" + HEAD + RUNS.replace("cv,", "own,"),
        [(1, "own.py does not exist: give a Python file")],
    ),
    "a file to use that is a mapping": ("use: {own: py}\n" + HEAD + RUNS, [(1, "use is a mapping: give one value")]),
}


def test_the_lists_of_a_valid_file_are_expanded(tmp_path):
    file = tmp_path / "good.yaml"
    file.write_text(GOOD)
    campaign = read_campaign(file)
    assert campaign.name == "good"
    assert [s.name for s in campaign.specimens] == ["dense-s1", "dense-s2", "loose"]
    sizes = [(s.recipe.seed, s.recipe.grains, s.recipe.side) for s in campaign.specimens]
    assert sizes == [(1, 150, None), (2, 150, None), (1, None, 1e-3)]
    assert [(c.name, c.source) for c in campaign.consolidations[:2]] == [
        ("dense_1MPa-s1", "specimens/dense-s1.state.nc"),
        ("dense_1MPa-s2", "specimens/dense-s2.state.nc"),
    ]
    names = [r.name for r in campaign.runs]
    assert len(names) == len(set(names)) == 1 + 3 * 2 * 2 + 2
    assert "cp-dense-s2-p500kPa-yade" in names and "cv" in names and "cyclic-dense_1MPa-s1" in names
    cv, cp = campaign.runs[:2]
    assert (cv.path, cv.options.snapshots, cv.device.name) == (ConstantVolume(strain=0.05, rate=20.0), 3, "fused")
    quick = SETTINGS["quick"]
    default = default_rate(type(cp.path), cp.scene)
    assert cp.path.rate == quick.rate_factor * default and cp.path.strain == type(cp.path).strain
    steps = [cv.scene.time_step_factor, campaign.specimens[0].scene.time_step_factor]
    assert steps == [quick.time_step_factor] * 2 and campaign.specimens[2].scene.time_step_factor == 0.2


PAIRED = """
specimens:
  sand:
    pairs:
      - {void_ratio: 0.62, step1_friction: 0.05}
      - {void_ratio: 0.67, step1_friction: 0.12}
      - {void_ratio: 0.72, step1_friction: 0.3}
    grains: 200
    friction: [0.3, 0.5]
runs:
  cr: {path: cr, specimen: sand, strain: 0.01, pairs: [{pressure: 100 kPa, rate: 5}, {pressure: 300 kPa, rate: 10}]}
"""


def test_paired_values_stay_together(tmp_path):
    (tmp_path / "c.yaml").write_text(PAIRED)
    jobs = read_campaign(tmp_path / "c.yaml").jobs
    made = {
        job.name: (job.recipe.void_ratio, job.recipe.step1_friction, job.scene.friction) for job in jobs if job.recipe
    }
    rows = [(0.62, 0.05), (0.67, 0.12), (0.72, 0.3)]
    assert made == {f"sand-void_ratio{e:g}-friction{f:g}": (e, mu, f) for e, mu in rows for f in (0.3, 0.5)}
    runs = [job.path for job in jobs if job.path]
    assert len(runs) == 12 and {(path.pressure, path.rate) for path in runs} == {(100e3, 5.0), (300e3, 10.0)}


def test_every_scalar_key_of_an_entry_may_be_a_list(tmp_path):
    file = tmp_path / "lists.yaml"
    file.write_text(
        "specimens:\n"
        "  a: {void_ratio: [0.6, 0.7], grains: 150, law: [spring_dashpot, hertz_mindlin], seed: [1, 2]}\n"
        "  b: {from: a, pressure: [100 kPa, 0.2 MPa]}\n"
        "runs:\n"
        "  cp: {path: cp, specimen: [a, b], pressure: [100 kPa, 0.3 MPa], strain: [1 %, 2 %], friction: [0.3, 0.5]}\n"
    )
    campaign = read_campaign(file)
    assert len(campaign.specimens) == 8 and len([c for c in campaign.consolidations if "-at-" not in c.name]) == 16
    assert len({run.name for run in campaign.runs}) == len(campaign.runs) == 24 * 2 * 2 * 2
    assert {run.device.name for run in campaign.runs} == {"fused"}
    specimen = next(one for one in campaign.specimens if one.name == "a-void_ratio0.7-law-hertz_mindlin-s2")
    assert (specimen.recipe.void_ratio, specimen.scene.law, specimen.recipe.seed) == (0.7, "hertz_mindlin", 2)
    consolidated = {one.name: one for one in campaign.consolidations}["b-void_ratio0.6-law-spring_dashpot-s1-p200kPa"]
    assert consolidated.source == "specimens/a-void_ratio0.6-law-spring_dashpot-s1.state.nc"
    assert consolidated.pressure == 0.2e6
    run = next(one for one in campaign.runs if one.name == f"cp-strain0.02-friction0.3-{specimen.name}-p300kPa")
    assert (run.path.strain, run.path.pressure, run.scene.friction) == (0.02, 0.3e6, 0.3)


def test_keys_of_the_material_for_specimens_and_runs(tmp_path):
    """Values may have a unit or be in SI units; those at the top of the file are defaults."""
    file = tmp_path / "material.yaml"
    file.write_text(
        "friction: 0.5\nspecimens:\n"
        "  a: {void_ratio: 67 %, grains: 150, young_modulus: 0.3 GPa, mean_diameter: 200 um, density: 2.7 g/cm3}\n"
        "  b: {void_ratio: 0.67, grains: 150, friction: 0.3}\n"
        "runs:\n"
        "  cv: {path: cv, specimen: [a, b], rolling_friction: 0, record_strain: 0.2 %, save_every: 7, rate: 20}\n"
        "  cp: {path: cp, specimen: a, pressure: 5000000}\n  low: {path: isod, specimen: a, pressure: 50 Pa}\n"
    )
    campaign = read_campaign(file)
    a, b = campaign.specimens
    assert (a.recipe.void_ratio, a.scene.young_modulus, a.scene.friction) == (0.67, 0.3e9, 0.5)
    assert (a.scene.mean_diameter, a.scene.density) == pytest.approx((200e-6, 2700.0)) and b.scene.friction == 0.3
    of_a, of_b, cp, low = campaign.runs
    assert of_a.scene == dataclasses.replace(a.scene, rolling_friction=0.0)
    assert of_b.scene == dataclasses.replace(b.scene, rolling_friction=0.0)
    assert (of_a.options.record_strain, of_a.options.save_every) == (0.002, 7)
    assert of_a.path.rate == 20.0
    assert (cp.path.pressure, low.path.pressure) == (5e6, 50.0)  # below 0.02 E of these grains


@pytest.mark.parametrize("name", BROKEN)
def test_an_invalid_file_is_refused_with_all_its_errors(name, tmp_path):
    text, expected = BROKEN[name]
    file = tmp_path / "broken.yaml"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        read_campaign(file)
    first, *reported = str(caught.value).splitlines()
    assert first.startswith(f"{file} ")
    for line, message in expected:
        assert any(one.startswith(f"  line {line}: ") and message in one for one in reported), "\n".join(reported)
    assert len(reported) == len(expected), "\n".join(reported)


def test_a_file_that_cannot_be_read(tmp_path):
    for make in (lambda f: None, lambda f: f.mkdir(), lambda f: f.write_bytes(b"\xff\xfe\x00")):
        file = tmp_path / "nothing.yaml"
        make(file)
        with pytest.raises(InputError, match=r"cannot be read|not UTF-8"):
            read_campaign(file)
        if file.is_dir():
            file.rmdir()


def test_the_cell_of_a_specimen_is_that_of_its_consolidations_unless_they_say_another(tmp_path):
    text = (
        "specimens:\n"
        "  a: {void_ratio: 0.67, grains: 150}\n"
        "  old: {void_ratio: 0.67, grains: 150, cell: fixed}\n"
        "  a2: {from: a, pressure: 200 kPa}\n"
        "  old2: {from: old, pressure: 200 kPa}\n"
        "  both: {from: old, pressure: 200 kPa, cell: [free, fixed]}\n"
        "runs:\n  cp: {path: cp, specimen: [a, old], pressure: 300 kPa}\n"
    )
    (tmp_path / "c.yaml").write_text(text)
    jobs = read_campaign(tmp_path / "c.yaml").jobs
    cells = {job.name: job.cell for job in jobs if job.kind != "run"}
    inserted = {name: cell for name, cell in cells.items() if "-at-p300kPa-" in name}
    assert [cells[name] for name in ("a", "a2", "old", "old2")] == ["free", "free", "fixed", "fixed"]
    assert sorted(cell for name, cell in cells.items() if name.startswith("both")) == ["fixed", "free"]
    assert {name.partition("-")[0]: cell for name, cell in inserted.items()} == {"a": "free", "old": "fixed"}
    assert all(f"--cell={job.cell}" in job.command for job in jobs if job.kind != "run")
