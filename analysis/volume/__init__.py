"""Study: the stress-force-fabric equation by volume, for wide gradings and other shapes, against Love's stress."""
