"""Light and how it moves: environment maps and their layouts, procedural skies, rotations and other sequences."""
