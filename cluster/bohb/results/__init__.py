"""What a study has found: numbers, tables and pictures of its journal."""
