"""Messages and topics of the bus: values, encoding and decoding, no I/O."""
