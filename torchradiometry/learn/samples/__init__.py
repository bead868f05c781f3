"""What networks are shown: random shapes, their materials, their light, and a camera."""
