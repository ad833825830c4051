"""Pictures of cameras on the bus, for the pages that look at them."""
