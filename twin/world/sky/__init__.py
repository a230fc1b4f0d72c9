"""Sun, moon, sky, weather and wind."""
