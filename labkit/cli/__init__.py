"""The command line: `labkit COMMAND`."""


def main(argv=None):
    """Runs a command line; returns its exit code."""
    from labkit.cli import app

    return app.main(argv)


def call(argv):
    """Runs a command line; raises where it gives up."""
    from labkit.cli import app

    return app.call(argv)
