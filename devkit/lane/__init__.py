"""Lane keeping by camera: markings, the lane's curve, lateral control."""
