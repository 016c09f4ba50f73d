"""The built-in scenes, and the shapes that they are made of."""
