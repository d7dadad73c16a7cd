"""Summary, tables and pictures of a study."""
