"""Result stores: a folder, or an object store behind a URL; workers and conductors use them."""
