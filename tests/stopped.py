"""Runs that end before their path is complete."""

import pytest

import labkit as lk


class Enough(Exception):
    """Raised by a function that reports progress."""


def run_stopped(share, specimen, path, **options):
    """Run a path until more than a share of it is done."""

    def stop(fraction, text):
        if fraction > share:
            raise Enough

    with pytest.raises(Enough):
        lk.run(specimen, path, **{**options, "progress": stop})
