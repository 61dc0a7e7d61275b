"""Places, angles and shapes, without roads or traffic."""
