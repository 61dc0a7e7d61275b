"""Roads: lanes and where one may drive, also above each other."""
