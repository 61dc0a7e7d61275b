"""What makes our tables, pictures and measurements; no part of what is installed."""
