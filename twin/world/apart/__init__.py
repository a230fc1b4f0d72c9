"""Files of others are parsed in a process apart, which may be taken over without harm."""
