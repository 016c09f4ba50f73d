"""V is light: a follower over a transport, frames of it in files, and the entrants that are compared."""
