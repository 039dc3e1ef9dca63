"""What the benchmarks share: timing, counting, the machine's limits."""
