"""How networks learn: a description, its steps, checkpoints, one or several processes."""
