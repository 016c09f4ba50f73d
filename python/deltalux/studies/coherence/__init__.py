"""Studies of the temporal coherence of light, and of what the methods make of it (Overbeck 2006, chapters 5 to 7)."""
