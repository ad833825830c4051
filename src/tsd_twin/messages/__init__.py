"""Bus messages and topics: values, encoding and decoding, without I/O."""
