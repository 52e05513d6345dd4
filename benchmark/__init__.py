"""The benchmark: drops, photographs, localises, picks, and keeps count. `benchmark.cli` is its door."""
