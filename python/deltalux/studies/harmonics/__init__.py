"""Studies of spherical harmonics beside wavelets (Overbeck 2006, chapter 8; Sloan 2005)."""
