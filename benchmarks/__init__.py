"""Makes our tables, pictures and measurements; it is not installed with the package."""
