"""A campaign: specimens and runs defined in one file, which a workflow engine carries out.

document      YAML with line numbers: the fields of a mapping, and every error
keys          keys allowed in an entry, from the central parameter table
items         contents of a campaign as value objects
file          reads a campaign file; specimens, runs: its two sections; copies files that it uses (`use:`)
plan          jobs: commands of labkit, with the files that they read and write
cost          steps, time, memory and disk space that jobs and commands need; speeds: of the engines
workflow      starts Snakemake (Snakefile, profiles/) and reports what failed
products      statistics of each run; report: the page on all runs
tables        the same campaign as tables for yade-batch
collection    all runs as one lazy object
quick.yaml    a campaign that comes with labkit
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.campaigns.collection import open_campaign as open_campaign
    from labkit.campaigns.file import CAMPAIGN as CAMPAIGN
    from labkit.campaigns.file import campaign_file as campaign_file
    from labkit.campaigns.file import read_campaign as read_campaign
    from labkit.campaigns.items import Campaign as Campaign
    from labkit.campaigns.items import Consolidated as Consolidated
    from labkit.campaigns.items import PlannedRun as PlannedRun
    from labkit.campaigns.items import Specimen as Specimen
    from labkit.campaigns.plan import RUNS as RUNS
    from labkit.campaigns.plan import Job as Job
    from labkit.campaigns.plan import Plan as Plan
    from labkit.campaigns.plan import plan_of as plan_of
    from labkit.campaigns.workflow import run_workflow as run_workflow
    from labkit.campaigns.workflow import tell as tell
else:
    __getattr__, __dir__, __all__ = attach(__name__)
