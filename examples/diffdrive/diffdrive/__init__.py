"""Differential drive for tsd-twin: two wheels on one axle, and a caster."""
