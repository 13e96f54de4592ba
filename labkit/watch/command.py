"""`labkit watch`: plot runs in the terminal."""

from __future__ import annotations

from typing import Annotated

from labkit.cli.arguments import Option
from labkit.cli.registry import command


@command("watch")
def watch_command(
    run: Annotated[list[str], Option("run file, complete or not")],
    *,
    interval: Annotated[int, Option("time between two plots in s", "SECONDS")] = 5,
    once: Annotated[bool, Option("plot once and stop")] = False,
) -> None:
    """Plots runs in the terminal repeatedly while they are computed.

    Writes no file. Stop it with Ctrl-C.

    Example:
        labkit watch *.run.nc
    """
    from labkit.watch.terminal import watch

    watch(run, interval, once)
