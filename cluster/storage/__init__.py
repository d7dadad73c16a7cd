"""What lies on disk: the home folder, a run's folder, files of lines."""
