"""What kind of scenario a case is, in words, decided from its tracks and its map alone."""
