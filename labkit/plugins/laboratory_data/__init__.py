"""Tests measured in a laboratory: read, compared with simulations, and used to calibrate the grains.

reading      tables and AGS4 as run files: a measured test is a Run without grains
layout       where the table of a file is: what the user says of it, headers, units, rows
table        columns of a table as numbers: every row is used or named
measured     a measured test as its checks need it
units        units of strains and stresses, also in headers
checks       units, signs, pressures, and tests that were joined by mistake
starts       strains, stresses and pore pressures that count from elsewhere
comparing    scatter between tests, and the misfit of a run relative to it
sampling     repeats measured tests on grains with different parameters, one sample after another
posterior    distribution of the parameters, given samples and measurements
sheet        a test predicted from a posterior, with intervals, as a PDF; ags4 writes it as AGS4
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.plugins.laboratory_data.comparing import remarks as remarks
    from labkit.plugins.laboratory_data.comparing import scatter_between as scatter_between
    from labkit.plugins.laboratory_data.posterior import posterior_of as posterior_of
    from labkit.plugins.laboratory_data.reading import preview as preview
    from labkit.plugins.laboratory_data.sampling import Sample as Sample
    from labkit.plugins.laboratory_data.sampling import read_samples as read_samples

    __all__: list[str]
else:
    __getattr__, __dir__, __all__ = attach(__name__)
