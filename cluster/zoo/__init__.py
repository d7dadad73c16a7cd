"""Building the SEs of the zoo, and listing them."""
