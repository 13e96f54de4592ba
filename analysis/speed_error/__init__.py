"""The study of speed against error: its design, its runs, their errors, its figures and its page."""
