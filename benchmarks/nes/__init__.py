"""NES runs over many seeds (docs/nes.md)."""
