"""Cases of storyboards: the family, its bodies in the simulator, and checks before they run."""
