"""Surfaces with their materials: what a scene consists of, and what a transport keeps of it."""
