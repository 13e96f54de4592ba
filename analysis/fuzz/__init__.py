"""Damaged files, hostile options and campaign files, with new seeds: `./lab fuzz --minutes N`.

Each input must end in one of two ways: it is used and gives the numbers of the undamaged input, or it is refused in one
sentence. Anything else is kept as a regression file.
"""
