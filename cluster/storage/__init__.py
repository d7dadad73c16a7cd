"""Files on disk: the home folder, run folders, JSON lines files."""
