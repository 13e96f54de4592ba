"""Is (e, Z, Lambda, A, F, F^t) a state? Data, twins, and a law for reversals and rotation."""
