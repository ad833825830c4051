"""Digital twin and remote driving for omnidirectional robots."""

__version__ = "0.1.0"
