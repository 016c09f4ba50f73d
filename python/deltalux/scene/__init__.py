"""What is looked at: sources hand over their `content`; `Scene` alone checks it and puts it together."""
