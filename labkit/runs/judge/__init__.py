"""Assessment of results: verification of a run, and critical states."""
