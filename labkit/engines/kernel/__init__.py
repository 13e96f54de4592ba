"""The compiled kernel of the fused engine.

layout.py      how contacts and grains lie in memory, and the compiler's settings
lanes.py       eight records of grains at once, into rows of a block and back
neighbours.py  which grains may touch: spatial order, pairs, images
law_yade.py    contact forces after YADE
law_paper.py   contact forces after Eqs. 1-3
motion.py      grains and cell
steps.py       the loop over steps that joins them
"""
