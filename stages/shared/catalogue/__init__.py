"""Public data sets by name: their addresses and licences, and how they are downloaded."""
