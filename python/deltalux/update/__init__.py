"""Choosing: the methods, and the copy of V that follows a moving V by one of them.

It needs neither a scene nor a light nor M, only vectors.
"""
