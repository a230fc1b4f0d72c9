"""What every process of ours stands on: errors, command lines, files, child processes."""
