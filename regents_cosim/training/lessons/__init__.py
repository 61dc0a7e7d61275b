"""Teaches AIM-BEV: its lessons from recorded traffic, its teachers, and the loop in torch."""
