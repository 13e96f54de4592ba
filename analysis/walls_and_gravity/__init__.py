"""Love's stress beside walls and planes, and the fabric of deposited grains: scenes on YADE."""
