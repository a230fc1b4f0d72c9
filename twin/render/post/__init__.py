"""What lens, shutter and film do to a picture, in the order it happens."""
