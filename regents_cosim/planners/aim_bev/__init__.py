"""AIM-BEV, the neural ego of the ReGentS paper: a bird's-eye view in, waypoints out."""
