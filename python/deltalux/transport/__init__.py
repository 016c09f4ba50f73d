"""Keeping M: an opened transport as an array that multiplies, and the plan that it was made by.

It knows no mesh and no ray.
"""
