"""Programs of JAX: compiled, kept on disk, and put on the device."""
