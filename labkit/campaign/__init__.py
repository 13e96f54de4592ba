"""A campaign: specimens and runs that a person writes down in one file and a workflow engine carries out.

`file.py` reads the file and finds every mistake in it, with its line; `values.py` reads numbers with units;
`plan.py` makes jobs of it, each a command of labkit with its files; `cost.py` says what they take; `Snakefile` and
`profiles/` are for Snakemake; `workflow.py` starts it and says what failed; `products.py` makes statistics, figures
and the report; `tables.py` writes yade-batch tables; `collection.py` opens all runs as one object;
`quick.yaml` and `paper.yaml` are campaigns that come with labkit.
"""
