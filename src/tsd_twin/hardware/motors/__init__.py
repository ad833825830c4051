"""Motor controllers on CAN: frames of VESC and moteus, and how each is stopped. Pure."""
