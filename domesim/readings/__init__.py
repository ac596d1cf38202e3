"""From a meter's readings of displays to what the models need (see `pair`)."""
