"""Playing of scenario files without a stack (`twin play`)."""
