"""What lights a picture: sky, lamps, and the air between."""
