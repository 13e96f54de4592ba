"""Returns the command equivalent to a job, for provenance and people; labkit never reads the command."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from labkit.errors import option_name
from labkit.grains.scene import Scene
from labkit.parameters import LARGE_STRAIN, Parameter, options_of
from labkit.plugins.campaigns import keys
from labkit.plugins.campaigns.jobs import Job
from labkit.records.schedule import Options
from labkit.specimens.recipe import Recipe

VERBS = {"specimen": "specimen", "consolidation": "consolidate", "run": "run"}


def words_of(job: Job, scene: Scene | None = None) -> list[str]:
    """Return the words of a job's command after `labkit`, without its output; `scene`: the Scene of its source."""
    before = [] if job.source is None else [job.source]
    if job.recipe is not None:
        words = _options(options_of(Recipe), vars(job.recipe))
        words += _options(options_of(Scene), job.scene.values(), Scene().values())
    elif job.path is not None:
        parameters = options_of(type(job.path))
        before = [job.path.name, *before]
        words = _options(
            parameters, vars(job.path), {name: parameter.default for name, parameter in parameters.items()}
        )
        words += _options(options_of(Options), vars(job.options))
        words += _options(keys.changes_of_runs(), job.scene.values(), {} if scene is None else scene.values())
    else:
        words = [f"--pressure={_text(job.pressure, 'Pa')}", f"--cell={job.cell}"]
    device = job.device
    counts = [("threads", device.threads), ("ranks", device.ranks)]
    words += [f"--engine={device.name}"]
    words += [f"--{name}={n}" for name, n in counts if n > 1 or name == device.kind.abilities.parallel[0]]
    return [VERBS[job.kind], *before, *words, *[f"--precision={device.precision}"] * (device.precision != "double")]


def _options(
    parameters: Mapping[str, Parameter], values: Mapping[str, object], defaults: Mapping[str, object] = {}
) -> list[str]:
    """Return command-line options for the values that are not None and differ from the defaults."""
    return [
        f"{option_name(name)}={_text(values[name], 'strain' if parameter.strain else parameter.unit)}"
        for name, parameter in parameters.items()
        if values.get(name) is not None and (name not in defaults or values[name] != defaults[name])
    ]


def _text(value: Any, unit: str) -> str:
    """Format a value as the text of an option, with all digits; a pressure and a large strain include their units."""
    if isinstance(value, tuple) and value and not isinstance(value[0], float | int):
        return json.dumps([dataclasses.asdict(part) for part in value])
    if isinstance(value, tuple):
        return ",".join(_text(part, unit) for part in value)
    if unit == "Pa" and isinstance(value, float):
        return f"{value!r}{unit}"
    if unit == "strain" and isinstance(value, float) and abs(value) > LARGE_STRAIN:
        return f"{100.0 * value!r}%"
    return value if isinstance(value, str) else repr(value)
