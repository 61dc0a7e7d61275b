"""Pictures, animations, tables and the HTML report of cases."""
