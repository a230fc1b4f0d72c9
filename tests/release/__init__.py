"""What a release is made of, and how it is looked at: ``make dist``, ``make licences``."""
