"""A campaign: specimens and runs that a person writes down in one file and a workflow engine carries out.

document      YAML with lines: fields of a mapping, and every mistake
keys          the keys that an entry may have, from the one table of parameters
items         what a campaign holds, as values
file          reads a campaign file; specimens, runs: its two sections
own_files     the user's own paths, laws and statistics (`use:`), copied into the folder
plan          jobs, each a command of labkit with its files
cost          what they take
workflow      starts Snakemake (Snakefile, profiles/) and says what failed
products      statistics of each run, and the report
tables        the same for yade-batch
collection    all runs as one object
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
