"""A package, so that the rig which its tests share ends with the last of them."""
