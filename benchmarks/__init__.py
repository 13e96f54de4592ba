"""Benchmarks of labkit: `./lab bench` and others, see README.md. They are not part of the installed package."""
