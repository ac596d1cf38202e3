"""Pictures that are compensated as they are shown: in a player, or in a process beside it."""
