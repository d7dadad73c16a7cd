"""NES runs over seeds (docs/nes.md)."""
