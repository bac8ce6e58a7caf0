"""A training run: its parts, its folder and checkpoints, its clock, and what a person sees of it."""
