"""The differentiable simulator: pure JAX, no files, no clocks, no globals."""
