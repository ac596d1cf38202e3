"""What is done to each frame of a show by the commands that compensate and predict."""
