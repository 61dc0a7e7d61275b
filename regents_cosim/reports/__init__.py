"""What people look at: still pictures and animations of cases."""
