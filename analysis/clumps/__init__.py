"""Study: a stress-force-fabric equation for clumps of several shapes."""
