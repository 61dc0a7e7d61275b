"""Which collisions of a search count, decided on the device."""
