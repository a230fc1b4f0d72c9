"""The project as a whole: ``drivetwin`` lists its commands."""
