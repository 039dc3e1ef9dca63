"""One network from several trainings of it: the mean of their weights."""
