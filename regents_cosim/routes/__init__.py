"""Which lanes an agent drives on, and where it goes from there."""
