"""Evidence on the search: its studies, and BOHB compared with other methods (docs/tuning.md)."""
