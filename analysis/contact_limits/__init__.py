"""Do the limits of Eqs. 2 and 3 apply to the spring forces, or to forces including the dashpots? Paired tests."""
