"""Benchmarks of speed and memory, each beside a peer or a lower bound measured in the same run."""
