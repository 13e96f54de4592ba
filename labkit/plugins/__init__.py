"""Plug-ins: packages that no room of labkit needs. Each registers what it adds, and may be deleted.

The module `plugin` of such a package offers engines, commands and figures to the same registries as a user's
file or an installed package. The module imports no library, because it is loaded whenever the commands are listed.
"""

from __future__ import annotations

import functools
import importlib
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from labkit.errors import InputError, notice

PLUGINS = (
    "plugins.campaigns",
    "plugins.laboratory_data",
    "plugins.exchange",
    "plugins.incremental",
    "plugins.umat",
    "plugins.probes",
    "plugins.calibration",
    "plugins.densities",
    "plugins.pictures",
    "plugins.page",
    "engines.lammps",
)


class Offer(NamedTuple):
    """A command of a plug-in: the module that defines the command, imported on first use, and a summary.

    In the list of all commands it follows the command `after`; without one it comes last.
    """

    module: str
    summary: str
    after: str


COMMANDS: dict[str, Offer] = {}  # by name


def register_command(name: str, module: str, summary: str, after: str = "") -> None:
    """Register a command that `module` defines with `@command(name, ...)`; the other arguments are those of Offer."""
    COMMANDS[name] = Offer(module, summary, after)


@functools.cache
def load_plugins(room: str = "plugins") -> None:
    """Load the plug-ins inside a package of labkit, by default those in labkit/plugins, and name those that fail."""
    for plugin in PLUGINS:
        module = f"labkit.{plugin}.plugin"
        if plugin.rpartition(".")[0] == room and is_there(module):
            try:
                importlib.import_module(module)
            except InputError:  # a user's file has taken a name of the plug-in
                raise
            except (Exception, SystemExit) as error:
                why = f"{type(error).__name__}: {error}"
                notice(f"the plug-in {module.split('.')[2]} is not loaded ({why}): install labkit again")


def plugin_of(place: str) -> str | None:
    """Return the plug-in that contains a module or a name, e.g. `plugins.exchange`, or None."""
    return next((plugin for plugin in PLUGINS if f"{place}.".startswith(f"labkit.{plugin}.")), None)


def is_there(place: str) -> bool:
    """Return True unless a module or a name belongs to a deleted plug-in."""
    plugin = plugin_of(place)
    return plugin is None or (Path(__file__).parents[1] / plugin.replace(".", "/") / "plugin.py").is_file()


def module_of_plugin(name: str, module: str) -> ModuleType:
    """Import a module of a plug-in, such as labkit.plugins.exchange.paraview, for a feature. Raises InputError."""
    if not is_there(module):
        raise InputError(f"{name} needs the plug-in {module.split('.')[2]}, which was deleted: install labkit again")
    return importlib.import_module(module)


def missing() -> str:
    """List the deleted plug-ins, for the end of an error message; empty if none is missing."""
    names = [plugin.rpartition(".")[2] for plugin in PLUGINS if not is_there(f"labkit.{plugin}")]
    return f" (not installed: {', '.join(names)})" if names else ""
