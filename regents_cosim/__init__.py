"""A crash-test bench for driving planners that lives inside SUMO and highway-env."""
