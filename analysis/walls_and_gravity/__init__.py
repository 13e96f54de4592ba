"""Love's stress against forces on walls and planes, and the fabric of deposited grains: scenes on YADE."""
