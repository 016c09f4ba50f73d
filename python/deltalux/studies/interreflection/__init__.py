"""Light between surfaces, and what the slides of Sloan, Lehtinen and Kautz (2005) show of transfer."""
