"""NES over seeds: what its defaults do, and what other choices would."""
