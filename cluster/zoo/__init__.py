"""Building the SEs of the zoo."""
