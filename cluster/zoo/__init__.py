"""Making SEs of the zoo anew, and listing them."""
