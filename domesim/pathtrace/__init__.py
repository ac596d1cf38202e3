"""Path-traced light transport: the only importer of Mitsuba and Dr.Jit."""
