"""What a careful driver would have done in the ego's place."""
