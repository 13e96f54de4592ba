"""A campaign: specimens and runs that are defined in one file and carried out by a workflow engine.

document      YAML with line numbers: the fields of a mapping, and every error
keys          keys allowed in an entry, from the central parameter table
items         contents of a campaign as value objects
file          reads a campaign file; specimens, runs: its two sections
own_files     user-supplied paths, laws and statistics (`use:`), copied into the campaign folder
plan          jobs: commands of labkit, with the files that they read and write
batches       runs that an engine advances together, as one job
cost          steps, time, memory and disk space that jobs and commands need; speeds: of the engines
workflow      starts Snakemake (Snakefile, profiles/) and reports what failed
products      statistics of each run; report: the page on all runs
tables        the same campaign as tables for yade-batch
collection    all runs as one lazy object
quick.yaml    a campaign that comes with labkit
"""

from labkit.lazy import attach

_NAMES = {
    "CAMPAIGN": "own_files",
    "Campaign": "items",
    "Consolidated": "items",
    "Run": "items",
    "Specimen": "items",
    "campaign_file": "file",
    "read_campaign": "file",
    "Job": "plan",
    "Plan": "plan",
    "RUNS": "plan",
    "plan_of": "plan",
    "open_campaign": "collection",
    "run_workflow": "workflow",
    "tell": "workflow",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
