"""Places, angles and shapes, independent of roads and traffic."""
