"""What may be believed, shown by experiments and benchmarks that anyone can rerun."""
