"""Data sets: a scene under thousands of lights, as files that anybody makes again to the bit."""
