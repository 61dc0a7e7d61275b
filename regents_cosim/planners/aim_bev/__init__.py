"""AIM-BEV, the neural planner of the ReGentS paper: it turns a bird's-eye view into waypoints."""
