"""Check input from outside before it is used."""
