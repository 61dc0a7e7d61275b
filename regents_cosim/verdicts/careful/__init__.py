"""What a careful driver, and two safety models, would have done in the ego's place."""
