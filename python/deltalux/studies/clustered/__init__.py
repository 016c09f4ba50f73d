"""Transport in two steps, beside transport in one."""
