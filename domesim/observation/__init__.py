"""From projected light to observed light, behind one abstraction (see ``base``)."""
