"""The stratified layer of Fig. 3: a plane layer of discs, coarse over fine.

layer      makes the layer, and computes the stresses in its strata
figure     draws the layer
study      the command `./lab stratified`
"""
