"""Reference drivers: what a careful human, a fuzzy safety model and RSS do, as planners and as measures of others."""
