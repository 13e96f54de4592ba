"""Effects of Z0 and of the preparation, 2 x 2, at equal e and p."""
