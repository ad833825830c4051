"""What crosses the bus, as values; encoding and decoding, no I/O."""
