"""What holds while a command runs: place, terminal, signals, and that MLflow follows."""
