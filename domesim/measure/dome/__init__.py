"""A dome theatre surveyed: from photographs of patterns to albedos, gain and ambient light."""
