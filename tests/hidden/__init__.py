"""Measured records with hidden physics, made independently of the package's own model, and their statistics."""
