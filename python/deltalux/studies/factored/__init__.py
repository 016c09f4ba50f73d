"""What factors keep of lobes that are seen from anywhere."""
