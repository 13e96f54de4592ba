"""The study of speed against error: design, runs, errors, figures and page."""
