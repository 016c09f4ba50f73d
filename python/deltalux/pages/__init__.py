"""How results are shown: a page, the look of plots, a verdict on a claim, and the machine that figures belong to."""
