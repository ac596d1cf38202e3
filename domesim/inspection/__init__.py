"""Figures of a scene before any work: coverage, brightness, contrast, plans to scale."""
