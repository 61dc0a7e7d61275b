"""Plans of an adversary in running traffic. Nothing here depends on SUMO."""
