"""From a colorimeter's readings of a display to what the models need (see ``pair``)."""
