"""The room of a dome theatre, as light meets it: screen, projectors, furniture, seats."""
