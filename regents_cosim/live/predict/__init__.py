"""How the traffic of a running simulation will go on."""
