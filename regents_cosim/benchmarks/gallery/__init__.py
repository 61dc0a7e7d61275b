"""The figures of the ReGentS paper, made anew: gradients around the ego, and four ways in which KING fails."""
