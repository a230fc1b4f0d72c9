"""The world: weather, sun, streets and the meshes they are made of."""
