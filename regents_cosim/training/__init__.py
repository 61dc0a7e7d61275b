"""Trains AIM-BEV: from recorded traffic, from its own crashes, and against fresh attacks."""
