"""How well the model predicts tests it was not fitted to, which readings fit best, and which terms C1 to C5 lack."""
