"""Images in files: what is read of them, what their headers say, and in which colours."""
