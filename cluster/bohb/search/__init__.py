"""The search: proposals, promotions, objective and validation."""
