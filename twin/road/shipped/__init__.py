"""Roads that ship with the project: a motorway, a rural road, a street, a junction."""
