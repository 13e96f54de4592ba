"""Do the limits of Eqs. 2 and 3 apply to the spring forces, or to those including the dashpots? Tests in pairs."""
