"""Tags of a case: words for what it shows, decided from its tracks and its map alone."""
