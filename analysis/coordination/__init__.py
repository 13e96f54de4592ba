"""Z0 against the way of preparation, 2 x 2, at equal e and p."""
