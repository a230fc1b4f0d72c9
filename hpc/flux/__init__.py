"""The batch system Flux, over its command-line tool."""
