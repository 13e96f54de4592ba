"""The identity of a run is its physics: comments, labels and line numbers of a path file make no other run."""

import pytest

import labkit as lk
from labkit.campaigns.jobs import digest_of
from labkit.errors import InputError
from labkit.records.identity import difference

PATH = """path: steps
steps:
  - {{strain: {{zz: {strain} %, xx: 0, yy: 0}}, records: 4{label}}}
  - {{strain: {{zz: 0.1 %}}, records: 4, until: "{until}"}}
"""


def written(folder, comment="", strain=0.1, label="", until="q > 1 MPa"):
    file = folder / "p.yaml"
    file.write_text(comment + PATH.format(strain=strain, label=label, until=until))
    return lk.read_path(file)


def test_a_comment_a_label_or_a_blank_makes_no_other_run(soft_specimen, tmp_path):
    output = tmp_path / "r.run.nc"
    first = lk.run(soft_specimen, written(tmp_path), file=output, progress=False)
    hash_ = first.data.attrs["data_sha256"]
    for change in ({"comment": "# later\n\n"}, {"label": ", label: load"}, {"until": "q  >  1 MPa"}):
        again = lk.run(soft_specimen, written(tmp_path, **change), file=output, progress=False)
        assert again.data.attrs["data_sha256"] == hash_
    with pytest.raises(InputError) as error:
        lk.run(soft_specimen, written(tmp_path, comment="# x\n", strain=0.2), file=output, progress=False)
    assert "step 1: " in str(error.value) and "in line" not in str(error.value)


def test_the_difference_is_named_in_few_words():
    one = {"path": "steps", "steps": [{"label": "a", "strain": [0.1] * 200}] * 3, "rate": 1.0}
    assert difference(one, {**one, "steps": [{"label": "b", "strain": [0.1] * 200}] * 3}) == ""
    assert difference(one, {**one, "steps": one["steps"][:2]}) == "it has 3 steps in the file, 2 here"
    long = difference(one, {**one, "steps": [*one["steps"][:2], {"label": "a", "strain": [0.2] * 200}], "rate": 2.0})
    assert long.startswith("step 3: strain is ") and "rate is 1 in the file, 2 here" in long and len(long) < 240
    many = {f"k{k}": k for k in range(9)}
    assert difference(many, {name: -1 - value for name, value in many.items()}).endswith("; 6 more")


def test_a_label_makes_no_other_job_of_a_campaign():
    task = {
        "path": {"name": "steps", "steps": [{"label": "step in line 3"}]},
        "device": {"name": "fused", "threads": 1},
    }
    moved = {**task, "path": {"name": "steps", "steps": [{"label": "step in line 4"}]}}
    assert digest_of(task, []) == digest_of(moved, []) != digest_of({**task, "pressure": 1e5}, [])
