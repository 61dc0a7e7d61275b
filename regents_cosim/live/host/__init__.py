"""The running simulation: read step by step, with some vehicles taken over."""
