"""A campaign: specimens and runs defined in one file, which a workflow engine carries out.

keys          keys allowed in an entry, from the central parameter table; reads an entry and its `pairs`
file          reads a campaign file into jobs (labkit.plugins.campaigns.jobs)
specimens     reads the section `specimens` of a campaign file; runs reads the section `runs`
layout        files of a campaign folder, and plan.json, which the workflow engine reads
plan          writes plan.json and the recipe of each job, which the job reads
job           carries out one job
cost          table of the time and disk space that jobs need
workflow      starts Snakemake (Snakefile, profiles/) and reports what failed
products      statistics of each run; figure draws the overview, and report writes the page on all runs
collection    opens all runs as one lazy object
quick.yaml    a campaign that comes with labkit
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.plugins.campaigns.file import read_campaign as read_campaign
    from labkit.plugins.campaigns.layout import CAMPAIGN as CAMPAIGN
    from labkit.plugins.campaigns.layout import RUNS as RUNS
    from labkit.plugins.campaigns.workflow import run_workflow as run_workflow
    from labkit.plugins.campaigns.workflow import tell as tell
else:
    __getattr__, __dir__, __all__ = attach(__name__)
