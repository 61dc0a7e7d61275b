"""Reference drivers as planners: a careful human driver, a fuzzy safety model, and RSS."""
