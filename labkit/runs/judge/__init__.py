"""Judgement of results: verification of a run file, critical states."""
