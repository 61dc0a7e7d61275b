"""What the law, safety models and tyres ask of a driver: constants and rules, for NumPy and JAX arrays alike."""
