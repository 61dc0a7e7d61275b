"""Methods of attack and their settings."""
