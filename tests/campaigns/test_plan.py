"""Earlier results after a change of the campaign file."""

from labkit.campaigns.file import read_campaign
from labkit.campaigns.plan import OUTDATED, plan_of, write_recipes

TEXT = """\
engine: fused
specimens:
  a: {void_ratio: 0.67, grains: 150}
  b: {void_ratio: 0.70, grains: 150}
runs:
  cv: {path: cv, specimen: [a, b], strain: 0.01}
"""


def outputs(folder, plan):
    return {job.output for job in plan.jobs if (folder / job.output).exists()}


def test_results_of_earlier_parameters_are_set_aside(tmp_path):
    """They are moved at once, so that they do not count as finished if a job that they depend on fails now."""
    file = tmp_path / "c.yaml"
    file.write_text(TEXT)
    plan = plan_of(read_campaign(file))
    write_recipes(plan, tmp_path)
    made = [job.output for job in plan.jobs] + ["statistics/cv-a.nc", "figures/cv-a.png", "figures/cv-b.png"]
    for name in made:
        (tmp_path / name).write_text(name)
    write_recipes(plan, tmp_path)
    assert outputs(tmp_path, plan) == {job.output for job in plan.jobs}

    file.write_text(TEXT.replace("0.67", "0.68"))
    changed = plan_of(read_campaign(file))
    write_recipes(changed, tmp_path)
    assert outputs(tmp_path, changed) == {"specimens/b.state.nc", "runs/cv-b.run.nc"}
    assert {p.name for p in (tmp_path / OUTDATED).iterdir()} == {
        "a.state.nc",
        "cv-a.run.nc",
        "cv-a.nc",
        "cv-a.png",
    }
    assert (tmp_path / "figures/cv-b.png").exists()
