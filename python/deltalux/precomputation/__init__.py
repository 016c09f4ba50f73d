"""Making M: what a quality asks for, what it will cost, whether there is room for it, and the loop over tiles."""
