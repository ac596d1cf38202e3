"""What the operating system gives to this process: memory, signals, files and a console."""
