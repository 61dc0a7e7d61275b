"""Pictures of scenes and lines on a canvas."""
