"""The benchmark of constitutive models: the stored tests as one data set, its scores, and the models' results."""
