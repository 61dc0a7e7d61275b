"""The figures of the ReGentS paper, made again: gradients around the ego, and four ways in which KING fails."""
