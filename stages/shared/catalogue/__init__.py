"""Public data sets by name: where they are, under which licence, and how they are downloaded."""
