"""Benchmarks of speed and memory, compared with a peer or a lower bound in the same run."""
