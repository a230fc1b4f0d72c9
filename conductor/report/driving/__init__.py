"""Free driving: how many false full brakings on how many kilometres."""
