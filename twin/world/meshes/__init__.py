"""Triangle meshes, their materials, and files of them."""
