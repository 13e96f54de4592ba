"""What the limits of Eqs. 2 and 3 apply to: the forces of the springs, or those with their dashpots; in pairs."""
