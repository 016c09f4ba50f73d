"""What the papers claim of reflectance that is edited."""
