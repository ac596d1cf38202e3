"""A 3D cinema that keeps the eyes apart by polarisation."""
