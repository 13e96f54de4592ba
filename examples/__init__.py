"""Programs that use labkit, and files that add to it."""
