"""`./lab clumps`: runs the campaign, and writes results/clumps."""
