"""What the command line names until `./lab hard-cases` is the only one that does."""

GRAINS, SCENES = 500, {}
