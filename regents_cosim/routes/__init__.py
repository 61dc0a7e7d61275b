"""The lanes on which an agent drives, and its route from there."""
