"""How the other road users react: they follow, brake, give way, change lanes and swerve."""
