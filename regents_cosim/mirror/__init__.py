"""The mirror: a differentiable traffic simulator in pure JAX, without files, clocks or global state."""
