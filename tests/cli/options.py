"""The options of a command line, before a task is made of them, which would read the specimen."""

from labkit.cli.arguments import Made
from labkit.cli.dispatch import parser_for
from labkit.cli.registry import find_command
from labkit.cli.simulate import run_task


def run_options(words):
    """The arguments of `run_task` that `labkit run` followed by these words gives."""
    options = parser_for(find_command("run"), words).read(words)
    options.command_line = ""
    return Made(run_task).arguments(options)
