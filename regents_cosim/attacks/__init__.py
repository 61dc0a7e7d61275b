"""Search for controls of other road users that make the ego crash; independent of SUMO."""
