"""How well the model predicts tests it was not fitted to, which readings fit best, and what C1 to C5 lack."""
