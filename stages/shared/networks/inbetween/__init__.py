"""Other people's methods of filling, trained on one skeleton's poses, behind one interface (docs/benchmark.md)."""
