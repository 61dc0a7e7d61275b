"""What comes from outside, held to bounds before it is used."""
