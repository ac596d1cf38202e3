"""Pictures that the project renders itself: a night scene, and frames of an orrery."""
