"""What a search of a campaign means beyond its section: points, forks, and what makes no sense."""
