"""What agents learn on the real tasks, and on an SE that teaches agents of one's own."""
