"""Software on its way to a cluster: images, bundles, wheels."""
