"""Programs of JAX: compiled, traced, kept on disk, and put on the device."""
