"""Roads: lanes and drivable areas, also on several levels."""
