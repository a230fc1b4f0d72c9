"""How software gets to a cluster: images, bundles, wheels."""
